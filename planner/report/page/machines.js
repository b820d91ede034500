// Figures over many machines: distribution of the error, and effort against error for each plan.

class ShareChart extends Chart {
  scales() {
    this.percent = true;
    const { span: [low, high], log } = this.panel; // of all plans, so that hiding one moves nothing
    const [a, b] = log ? [low * 0.9, high * 1.1] : [0, high * 1.05 || 1];
    this.x = scale(a, b, EDGE.left, this.size.right, log);
    this.y = scale(0, 1, this.size.bottom, EDGE.top);
  }

  label() {
    const names = this.panel.series.map((s) => this.page.plans[s.plan].label);
    return `Share of machines with a smaller error, for ${names.join(", ")}. Arrow keys read values.`;
  }

  first() {
    return this.x.invert((this.x(this.x.low) + this.x(this.x.high)) / 2);
  }

  draw() {
    for (const series of this.panel.series) {
      if (!this.shown(series)) continue;
      const n = series.values.length;
      let d = `M${this.x(Math.max(this.x.low, series.values[0]))} ${this.y(0)}`;
      series.values.forEach((v, i) => {
        d += `H${this.x(Math.max(this.x.low, v)).toFixed(1)}V${this.y((i + 1) / n).toFixed(1)}`;
      });
      make("path", { class: this.classes(series, "curve"), d: `${d}H${this.size.right}` }, this.inside);
      for (const share of [0.5, 0.95]) {
        const cx = this.x(quantile(series.values, share));
        make("circle", { class: this.classes(series, "dot"), cx, cy: this.y(share), r: 4.5 }, this.over);
      }
    }
  }

  describe(x) {
    const rows = this.panel.series.filter((s) => this.shown(s)).map((s) => {
      const below = s.values.filter((v) => v <= x).length / s.values.length;
      return { plan: s.plan, text: `${(100 * below).toFixed(1)} %` };
    });
    return { head: `E below ${short(x, 3)} deg`, rows, px: this.x(x) };
  }
}

/** Quantile of increasing values, with linear interpolation. */
function quantile(values, share) {
  const p = share * (values.length - 1);
  const k = Math.floor(p);
  return values[k] + (p - k) * ((values[k + 1] ?? values[k]) - values[k]);
}

class PointsChart extends Chart {
  scales() {
    const list = this.panel.points; // of all plans, so that hiding one moves nothing
    const axis = (values, a, b, room, log) => {
      const [low, high] = [Math.min(...values), Math.max(...values)];
      return log ? scale(low / 1.5, high * room, a, b, true) : scale(0, high * room || 1, a, b);
    };
    const [x, y] = this.panel.log;
    this.x = axis(list.map((p) => p.x), EDGE.left, this.size.right, 1.6, x);
    this.y = axis(list.flatMap((p) => [p.y, p.high]), this.size.bottom, EDGE.top, 1.15, y);
  }

  label() {
    const said = this.panel.points.map(
      (p) => `${this.page.plans[p.plan].label}: effort ${short(p.x)}, E ${short(p.y, 3)} degrees`,
    );
    return `Effort against error. ${said.join("; ")}. Arrow keys go from plan to plan.`;
  }

  /** The points of the visible plans. */
  get places() {
    return this.panel.points.filter((p) => this.shown(p));
  }

  draw() {
    for (const point of this.places) {
      const [x, y] = [this.x(point.x), this.y(point.y)];
      make("path", { class: this.classes(point, "bar"), d: `M${x} ${y}V${this.y(point.high)}` }, this.over);
      make("circle", { class: this.classes(point, "dot"), cx: x, cy: y, r: 6 }, this.over);
    }
    this.drawNames();
  }

  /** Write the plans' names beside their points, without overlap of points, bars or other names. */
  drawNames() {
    const list = this.places.sort((a, b) => this.y(a.y) - this.y(b.y));
    const taken = list.map((p) => {
      const [x, dot] = [this.x(p.x), this.y(p.y)];
      return { left: x - 8, right: x + 8, top: Math.min(dot - 8, this.y(p.high)), bottom: dot + 8 };
    });
    for (const point of list) {
      const { label, colour } = this.page.plans[point.plan];
      const text = label + (this.page.plans[point.plan].refused ? " (refused)" : "");
      const name = make("text", { class: `name plan-${colour}`, text }, this.over);
      const wide = name.getComputedTextLength() || 7 * text.length;
      const place = this.placeName(this.x(point.x), this.y(point.y), wide, taken);
      if (!place) {
        name.remove(); // the legend tells colours, and the point its name
        continue;
      }
      taken.push(place);
      name.setAttribute("x", place.left + 1);
      name.setAttribute("y", place.bottom - 3);
    }
  }

  /** The box of a name: right, left, below or above its point and bar, if there is room. */
  placeName(px, py, wide, taken) {
    const half = wide / 2 + 1;
    const middle = Math.max(EDGE.left + half, Math.min(px, this.size.width - half));
    const sides = [around(px + 10 + half, py, half, 7), around(px - 10 - half, py, half, 7)];
    const steps = [16, 30, 44, 58].flatMap((d) => [around(middle, py + d, half, 7), around(middle, py - d, half, 7)]);
    const fits = (box) =>
      box.left >= EDGE.left && box.right <= this.size.width && box.top >= 0 && box.bottom <= this.size.bottom;
    const free = (box) => !taken.some((other) => meet(box, other));
    return [...sides, ...steps].find((box) => fits(box) && free(box));
  }

  nearest(px, py) {
    const far = (p) => Math.hypot(this.x(p.x) - px, this.y(p.y) - py);
    return this.places.reduce((a, b) => (a && far(a) <= far(b) ? a : b), null);
  }

  arrows = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 };

  step(now, way) {
    return this.places[this.places.indexOf(now) + way] ?? now;
  }

  get ends() {
    return [this.places[0] ?? null, this.places.at(-1) ?? null];
  }

  describe(point) {
    const of = (name, text) => ({ plan: point.plan, name, text });
    const { unit } = this.panel;
    return {
      head: this.page.plans[point.plan].label,
      rows: [
        of("effort", `${short(point.x)} ${this.panel.effort_unit}`),
        of(this.panel.middle, `${short(point.y, 3)} ${unit}`),
        of(this.panel.high, `${short(point.high, 3)} ${unit}`),
      ],
      px: this.x(point.x),
    };
  }
}

/** A box, given by its centre. */
function around(x, y, half, high) {
  return { left: x - half, right: x + half, top: y - high, bottom: y + high };
}

function meet(a, b) {
  return a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom;
}
