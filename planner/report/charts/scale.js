"use strict";
// Numbers on screen: scales, ticks, values between samples, and paths through points.

/** A mapping from data [low, high] to pixels [a, b], linear or logarithmic. */
function scale(low, high, a, b, log = false) {
  const f = log ? Math.log10 : (x) => x;
  const unit = (b - a) / (f(high) - f(low) || 1);
  const map = (x) => a + (f(x) - f(low)) * unit;
  map.invert = (p) => {
    const x = f(low) + (p - a) / unit;
    return log ? 10 ** x : x;
  };
  map.low = low;
  map.high = high;
  map.log = log;
  return map;
}

/** Round values inside [low, high], about `count` of them. */
function ticks(low, high, count, log = false) {
  if (log) {
    const out = [];
    for (let e = Math.floor(Math.log10(low)); e <= Math.ceil(Math.log10(high)); e++)
      for (const m of [1, 2, 5]) out.push(m * 10 ** e);
    const inside = out.filter((x) => x >= low * 0.999 && x <= high * 1.001);
    return inside.length > 2 * count ? inside.filter((x) => /^1/.test(x.toExponential())) : inside;
  }
  const step = roundStep((high - low) / Math.max(1, count));
  const out = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + step * 1e-9; k++) out.push(k * step);
  return out;
}

/** The least of 1, 2 and 5 times a power of ten that is not below `rough`. */
function roundStep(rough) {
  const power = 10 ** Math.floor(Math.log10(rough));
  return [1, 2, 5, 10].map((m) => m * power).find((s) => s >= rough * 0.999);
}

/** A number in few characters, with a true minus sign. */
function short(x, digits = 4) {
  if (x === null || x === undefined || !Number.isFinite(x)) return "–";
  const rounded = Number(x.toPrecision(digits));
  const size = Math.abs(rounded);
  const text = rounded !== 0 && (size < 1e-3 || size >= 1e6) ? rounded.toExponential() : String(rounded);
  return text.replaceAll("-", "−");
}

/** Index of the interval of increasing `t` that contains `x`, and the fraction inside it. */
function place(t, x) {
  let a = 0;
  let b = t.length - 1;
  while (b - a > 1) {
    const m = (a + b) >> 1;
    if (t[m] <= x) a = m;
    else b = m;
  }
  const width = t[b] - t[a];
  return [a, b, width > 0 ? Math.min(1, Math.max(0, (x - t[a]) / width)) : 0];
}

/** Value at x of samples y over increasing t; null outside or where undefined. */
function at(t, y, x) {
  if (x < t[0] - 1e-9 || x > t[t.length - 1] + 1e-9) return null;
  const [a, b, s] = place(t, x);
  if (y[a] === null || y[b] === null) return null;
  return y[a] + s * (y[b] - y[a]);
}

/** SVG path through points; null breaks it. */
function path(xs, ys) {
  let out = "";
  let pen = "M";
  for (let i = 0; i < xs.length; i++) {
    if (ys[i] === null) {
      pen = "M";
      continue;
    }
    out += `${pen}${Math.round(10 * xs[i]) / 10} ${Math.round(10 * ys[i]) / 10}`;
    pen = "L";
  }
  return out;
}

/** SVG path of a waypoint's mark. */
function diamond(x, y, r = 6) {
  return `M${x} ${y - r}l${r} ${r}l${-r} ${r}l${-r} ${-r}Z`;
}

const VECTORS = new Set("svg g path line rect circle text polyline clipPath".split(" "));

/** Create an element; SVG elements are recognised by name. */
function make(name, attributes = {}, parent = null) {
  const node = VECTORS.has(name)
    ? document.createElementNS("http://www.w3.org/2000/svg", name)
    : document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key === "text") node.textContent = value;
    else node.setAttribute(key, value);
  }
  if (parent) parent.append(node);
  return node;
}
