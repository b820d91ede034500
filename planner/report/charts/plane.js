// A figure in a plane: paths, with poses or shaded edges; values with the pointer or keys.

class PlaneChart extends Chart {
  /** Equal scale on both axes, to show true angles; or `view`, which fills the frame. */
  scales() {
    const { series, poses = [], discs = [], view } = this.panel;
    const { right, bottom } = this.size;
    const [wide, high] = [right - EDGE.left, bottom - EDGE.top];
    const rims = (axis) => discs.flatMap((d) => [d[axis] - d[2], d[axis] + d[2]]);
    const reach = [0, 1].map((k) => range([...series.map((s) => (k ? s.y : s.x)), rims(k), ...poses.map((pose) => pose.map((p) => p[k]))]));
    const unit = Math.max((reach[0][1] - reach[0][0]) / wide, (reach[1][1] - reach[1][0]) / high);
    const widen = ([a, b], size) => [(a + b - size * unit) / 2, (a + b + size * unit) / 2];
    this.x = scale(...(view?.[0] ?? widen(reach[0], wide)), EDGE.left, right);
    this.y = scale(...(view?.[1] ?? widen(reach[1], high)), bottom, EDGE.top);
  }

  render(wide) {
    super.render(wide);
    for (const mark of [this.cursor, this.cross]) mark.classList.add("ring");
  }

  label() {
    return `${this.panel.title}. Arrow keys go along the path.`;
  }

  /** The visible paths, each with the times of its plan. */
  paths() {
    const visible = this.panel.series.filter((s) => this.shown(s));
    return visible.map((s) => ({ ...s, t: this.page.plans[s.plan].t }));
  }

  /** When the first path begins and the last one ends. */
  get ends() {
    const paths = this.paths();
    return [Math.min(0, ...paths.map((s) => s.t[0])), Math.max(0, ...paths.map((s) => s.t.at(-1)))];
  }

  across() {
    return `${this.panel.names[0]} (${this.panel.unit})`;
  }

  frame() {
    const { right, bottom } = this.size;
    axes(this.svg, this.x, this.y, { ...EDGE, right, bottom }, { across: this.across(), square: true });
  }

  draw() {
    const { inside, panel } = this;
    const { right, bottom } = this.size;
    // Shade everything outside the region's box, with the even-odd rule.
    if (panel.region) {
      const [[left, east], [south, north]] = panel.region;
      const [a, b, c, d] = [this.x(left), this.x(east), this.y(north), this.y(south)];
      const frame = `M${EDGE.left} ${EDGE.top}H${right}V${bottom}H${EDGE.left}Z`;
      make("path", { class: "below", "fill-rule": "evenodd", d: `${frame}M${a} ${c}H${b}V${d}H${a}Z` }, inside);
      make("path", { class: "edge", d: `M${a} ${c}H${b}V${d}H${a}Z` }, inside);
    }
    for (const [axis, value] of panel.limits ?? []) {
      const d = axis ? `M${EDGE.left} ${this.y(value)}H${right}` : `M${this.x(value)} ${EDGE.top}V${bottom}`;
      make("path", { class: "limit", d }, inside);
    }
    drawSpace(inside, panel, this.x, this.y);
    (panel.poses ?? []).forEach((pose, k) => {
      const [xs, ys] = [pose.map((p) => this.x(p[0])), pose.map((p) => this.y(p[1]))];
      const late = k / Math.max(1, panel.poses.length - 1);
      make("path", { class: "pose", d: path(xs, ys), style: `stroke: ${hue(late)}` }, inside);
      xs.forEach((cx, i) => make("circle", { cx, cy: ys[i], r: 2.2, style: `fill: ${hue(late)}` }, inside));
    });
    for (const series of this.paths()) {
      const [xs, ys] = [series.x.map(this.spot(this.x)), series.y.map(this.spot(this.y))];
      make("path", { class: this.classes(series, "curve"), d: path(xs, ys) }, inside);
    }
    (panel.ends ?? []).forEach(([x, y], k) => {
      const [cx, cy] = [this.x(x), this.y(y)];
      make("circle", { class: "end", cx, cy, r: 4 }, this.over);
      make("text", { class: "place", x: cx + 7, y: cy + 14, text: k ? "goal" : "start" }, this.over);
    });
  }

  spot(scale) {
    return (value) => (value === null ? null : scale(value));
  }

  /** Time of the nearest point on a path. */
  nearest(px, py) {
    let [best, least] = [0, Infinity];
    for (const { x: xs, y: ys, t } of this.paths())
      xs.forEach((x, k) => {
        const far = x === null || ys[k] === null ? Infinity : Math.hypot(this.x(x) - px, this.y(ys[k]) - py);
        if (far < least) [best, least] = [t[k], far];
      });
    return best;
  }

  arrows = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1 };

  step(now, way, far) {
    const [first, last] = this.ends;
    return Math.min(last, Math.max(first, now + (way * (last - first)) / (far ? 20 : 100)));
  }

  /** Position of each path at a time: [series, x, y]; undefined positions are left out. */
  where(t) {
    const found = this.paths().map((s) => [s, ...[s.x, s.y].map((values) => at(s.t, values, Math.max(s.t[0], Math.min(t, s.t.at(-1)))))]);
    return found.filter(([, x, y]) => x !== null && y !== null);
  }

  describe(t) {
    const found = this.where(t);
    if (!found.length) return null;
    const { names, unit, series } = this.panel;
    const text = (value) => `${short(value)} ${unit}`;
    const rows =
      series.length === 1
        ? names.map((name, k) => ({ ...series[0], name, text: text(found[0][1 + k]) }))
        : found.map(([one, x, y]) => ({ ...one, text: `${short(x)}, ${text(y)}` }));
    return { head: `${t.toFixed(2)} s`, rows, px: this.x(found[0][1]), spot: this.rings(found) };
  }

  setCursor(t) {
    super.setCursor(t);
    this.cursor?.setAttribute("d", t === null || !this.x ? "" : this.rings(this.where(t)));
  }

  rings(found) {
    const ring = "a5 5 0 1 0 10 0a5 5 0 1 0 -10 0";
    return found.map(([, x, y]) => `M${this.x(x) - 5} ${this.y(y)}${ring}`).join("");
  }
}

/** Obstacles as discs, and waypoints. */
function drawSpace(svg, { discs = [], tips = [] }, x, y) {
  for (const [cx, cy, r] of discs)
    make("circle", { class: "disc", cx: x(cx), cy: y(cy), r: x(cx + r) - x(cx) }, svg);
  for (const [tx, ty] of tips) make("path", { class: "stop", d: diamond(x(tx), y(ty)) }, svg);
}

/** Colour of a pose by its time, from early (0, dark) to late (1, bright). */
function hue(late) {
  return `hsl(${265 - 205 * late}, 65%, ${38 + 12 * late}%)`;
}
