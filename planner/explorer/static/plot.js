// Curves, bands and bodies on a canvas: one function a kind of panel, no state but the canvas.

const COLOURS = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9"];
const EDGE = { left: 52, right: 10, top: 24, bottom: 24 };
const MARK = "#B00020";
const NAMES = 15; // a row of names between title and curves

function ticks(low, high, count) {
  const raw = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((k) => k * power).find((s) => s >= raw * 0.999);
  const found = [];
  for (let v = Math.ceil(low / step - 1e-9) * step; v <= high + 1e-9 * step; v += step) found.push(v);
  return { step, found };
}

function worded(value, step) {
  const digits = Math.max(0, Math.min(10, -Math.floor(Math.log10(step) + 1e-9)));
  return Math.abs(value) < step * 1e-6 ? "0" : value.toFixed(digits);
}

function extent(lists) {
  let low = Infinity, high = -Infinity;
  for (const list of lists)
    for (const v of list) {
      if (v === null) continue;
      if (v < low) low = v;
      if (v > high) high = v;
    }
  if (low > high) return [-1, 1];
  const pad = 0.06 * (high - low) || 0.06 * Math.abs(high) || 1e-3;
  return [low - pad, high + pad];
}

// The frame's mapping from data to pixels, kept for the pointer.
function frame(canvas, x, y, top = EDGE.top) {
  const ratio = window.devicePixelRatio || 1;
  const w = canvas.clientWidth || 380, h = canvas.clientHeight || 236;
  if (canvas.width !== Math.round(w * ratio) || canvas.height !== Math.round(h * ratio)) {
    canvas.width = Math.round(w * ratio);
    canvas.height = Math.round(h * ratio);
  }
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, w, h);
  const a = (w - EDGE.left - EDGE.right) / (x[1] - x[0]);
  const b = (h - top - EDGE.bottom) / (y[1] - y[0]);
  const style = getComputedStyle(canvas);
  const ink = (name, otherwise) => style.getPropertyValue(name).trim() || otherwise;
  return {
    pen, w, h, x, y, top, ink,
    X: (v) => EDGE.left + a * (v - x[0]),
    Y: (v) => h - EDGE.bottom - b * (v - y[0]),
    dataX: (px) => x[0] + (px - EDGE.left) / a,
    dataY: (py) => y[0] + (h - EDGE.bottom - py) / b,
  };
}

function axes(f, title, note, below) {
  const { pen, w, h } = f;
  pen.font = "11px system-ui, sans-serif";
  pen.lineWidth = 1;
  for (const [axis, count] of [["x", w / 70], ["y", h / 45]]) {
    const [low, high] = f[axis];
    const { step, found } = ticks(low, high, Math.max(2, count));
    for (const v of found) {
      pen.strokeStyle = f.ink("--px-grid", "#ddd");
      pen.fillStyle = f.ink("--px-soft", "#666");
      pen.beginPath();
      if (axis === "x") {
        const px = f.X(v);
        pen.moveTo(px, f.top);
        pen.lineTo(px, h - EDGE.bottom);
        pen.textAlign = "center";
        pen.fillText(worded(v, step), px, h - 8);
      } else {
        const py = f.Y(v);
        pen.moveTo(EDGE.left, py);
        pen.lineTo(w - EDGE.right, py);
        pen.textAlign = "right";
        pen.fillText(worded(v, step), EDGE.left - 5, py + 4);
      }
      pen.stroke();
    }
  }
  pen.textAlign = "left";
  if (below) pen.fillText(below, EDGE.left + 0.62 * (w - EDGE.left - EDGE.right), h - 8);
  pen.fillStyle = f.ink("--px-ink", "#222");
  pen.font = "600 12px system-ui, sans-serif";
  pen.fillText(title, 6, 14);
  if (note) {
    pen.font = "11px system-ui, sans-serif";
    pen.textAlign = "right";
    pen.fillStyle = f.ink("--px-soft", "#666");
    pen.fillText(note, w - EDGE.right, 14);
  }
}

function inside(f, draw) {
  f.pen.save();
  f.pen.beginPath();
  f.pen.rect(EDGE.left, f.top, f.w - EDGE.left - EDGE.right, f.h - f.top - EDGE.bottom);
  f.pen.clip();
  draw(f.pen);
  f.pen.restore();
}

// A curve with gaps where it does not exist (null).
function curve(f, xs, ys) {
  f.pen.beginPath();
  let down = false;
  for (let k = 0; k < xs.length; k++) {
    if (ys[k] === null || xs[k] === null) {
      down = false;
      continue;
    }
    if (down) f.pen.lineTo(f.X(xs[k]), f.Y(ys[k]));
    else f.pen.moveTo(f.X(xs[k]), f.Y(ys[k]));
    down = true;
  }
  f.pen.stroke();
}

function band(f, t, low, high) {
  const kept = t.map((_, k) => k).filter((k) => low[k] !== null && high[k] !== null);
  if (!kept.length) return;
  f.pen.beginPath();
  for (const k of kept) f.pen.lineTo(f.X(t[k]), f.Y(high[k]));
  for (const k of kept.reverse()) f.pen.lineTo(f.X(t[k]), f.Y(low[k]));
  f.pen.closePath();
  f.pen.fill();
}

// What the curves, bands and marks of a panel are called, and where that is written.
function places(canvas, panel) {
  const entries = panel.lines.map((line, k) => ({ name: line.name, colour: COLOURS[k % COLOURS.length], kind: "line" }));
  for (const b of panel.bands || []) entries.push({ name: b.name, kind: "band" });
  if ((panel.marks || []).length) entries.push({ name: "edge crossed", colour: MARK, kind: "mark" });
  if (entries.length < 2) return [];
  const pen = canvas.getContext("2d");
  pen.font = "11px system-ui, sans-serif";
  let x = 6, row = 0;
  for (const entry of entries) {
    const wide = pen.measureText(entry.name).width + 28;
    if (x > 6 && x + wide > (canvas.clientWidth || 380)) [x, row] = [6, row + 1];
    Object.assign(entry, { x, row });
    x += wide;
  }
  return entries;
}

function names(f, entries, faded) {
  f.pen.font = "11px system-ui, sans-serif";
  f.pen.textAlign = "left";
  f.pen.globalAlpha = faded;
  for (const { name, colour, kind, x, row } of entries) {
    const y = EDGE.top + NAMES * row + 6;
    f.pen.fillStyle = colour || f.ink("--px-band", "#DCEBF5");
    if (kind === "mark") f.pen.fillText("\u00d7", x + 4, y);
    else f.pen.fillRect(x, y - (kind === "band" ? 9 : 5), 14, kind === "band" ? 10 : 3);
    f.pen.fillStyle = f.ink("--px-ink", "#222");
    f.pen.fillText(name, x + 18, y);
  }
  f.pen.globalAlpha = 1;
}

function overTime(canvas, panel, faded) {
  const t = panel.t;
  const shown = panel.lines.map((line) => line.y);
  const bands = panel.bands || [];
  if (panel.id === "z2" || panel.id === "error") for (const b of bands) shown.push(b.low, b.high);
  if (panel.zero) shown.push([0]);
  if (panel.points) shown.push(panel.points.map((p) => p.at[1]));
  const entries = places(canvas, panel);
  const rows = entries.length ? 1 + entries[entries.length - 1].row : 0;
  const f = frame(canvas, [t[0], t[t.length - 1]], panel.range || extent(shown), EDGE.top + NAMES * rows);
  axes(f, panel.title, panel.note, "time (s)");
  const { pen } = f;
  pen.globalAlpha = faded;
  inside(f, () => {
    for (const b of bands) {
      pen.fillStyle = f.ink("--px-band", "#DCEBF5");
      band(f, t, b.low, b.high);
    }
    pen.strokeStyle = f.ink("--px-soft", "#666");
    if (panel.zero) curve(f, [t[0], t[t.length - 1]], [0, 0]);
    pen.setLineDash([2, 3]);
    for (const limit of panel.limits || []) curve(f, [t[0], t[t.length - 1]], [limit, limit]);
    pen.setLineDash(panel.refused ? [6, 4] : []);
    pen.lineWidth = 1.8;
    panel.lines.forEach((line, k) => {
      pen.strokeStyle = COLOURS[k % COLOURS.length];
      curve(f, t, line.y);
    });
    pen.setLineDash([]);
    pen.strokeStyle = MARK;
    for (const [x, y] of panel.marks || []) {
      pen.beginPath();
      for (const s of [-1, 1]) {
        pen.moveTo(f.X(x) - 5, f.Y(y) - 5 * s);
        pen.lineTo(f.X(x) + 5, f.Y(y) + 5 * s);
      }
      pen.stroke();
    }
    for (const point of panel.points || []) {
      pen.beginPath();
      pen.arc(f.X(point.at[0]), f.Y(point.at[1]), 6, 0, 7);
      pen.fillStyle = point.names ? f.ink("--px-ink", "#222") : "transparent";
      pen.strokeStyle = f.ink("--px-ink", "#222");
      pen.fill();
      pen.stroke();
    }
  });
  pen.globalAlpha = 1;
  names(f, entries, faded);
  return f;
}

// Equal scales, so that angles look as they are; poses from early (dark) to late (bright).
function inPlane(canvas, panel, faded) {
  const discs = panel.discs || [];
  const rims = (axis) => discs.flatMap((d) => [d[axis] - d[2], d[axis] + d[2]]);
  const xs = extent([panel.path[0], rims(0), ...panel.poses.map((p) => p.map((v) => v[0]))]);
  const ys = extent([panel.path[1], rims(1), ...panel.poses.map((p) => p.map((v) => v[1]))]);
  const wide = (canvas.clientWidth || 380) - EDGE.left - EDGE.right;
  const high = (canvas.clientHeight || 236) - EDGE.top - EDGE.bottom;
  const unit = Math.max((xs[1] - xs[0]) / wide, (ys[1] - ys[0]) / high);
  const widen = ([low, high], size) => {
    const extra = (size * unit - (high - low)) / 2;
    return [low - extra, high + extra];
  };
  const f = frame(canvas, widen(xs, wide), widen(ys, high));
  axes(f, panel.title, panel.note);
  const { pen } = f;
  pen.globalAlpha = faded;
  inside(f, () => {
    pen.fillStyle = f.ink("--px-soft", "#666");
    for (const [x, y, radius] of discs) {
      pen.beginPath();
      pen.arc(f.X(x), f.Y(y), f.X(x + radius) - f.X(x), 0, 7);
      pen.fill();
    }
    panel.poses.forEach((pose, k) => {
      const late = k / Math.max(1, panel.poses.length - 1);
      pen.strokeStyle = pen.fillStyle = `hsl(${265 - 205 * late}, 65%, ${38 + 12 * late}%)`;
      pen.lineWidth = 1.8;
      curve(f, pose.map((p) => p[0]), pose.map((p) => p[1]));
      for (const [x, y] of pose) {
        pen.beginPath();
        pen.arc(f.X(x), f.Y(y), 2, 0, 7);
        pen.fill();
      }
    });
    pen.strokeStyle = COLOURS[0];
    pen.lineWidth = 1.6;
    pen.setLineDash(panel.refused ? [6, 4] : []);
    curve(f, panel.path[0], panel.path[1]);
    pen.setLineDash([]);
  });
  pen.globalAlpha = 1;
  return f;
}

function draw(canvas, panel, faded = 1) {
  return panel.kind === "plane" ? inPlane(canvas, panel, faded) : overTime(canvas, panel, faded);
}
