// Common parts of all figures: frame, axes, legend, reading values with the pointer or keys.

const EDGE = { left: 50, right: 12, top: 8, bottom: 38 };
const HEIGHT = 220;
const MOST_ROWS = 6; // of values beside the pointer, which would cover the figure
let charts = 0;

class Chart {
  /**
   * @param host element to draw into
   * @param panel data to draw: kind, title, unit, series or points; it may be replaced later
   * @param page plans, which of them are visible, whether machines are, and a function to set the clock
   */
  constructor(host, panel, page) {
    Object.assign(this, { host, panel, page, reading: null, clock: null });
    this.id = `chart-${++charts}`;
    this.head = make("h3", {}, host);
    this.notes = make("p", { class: "notes" }, host);
    this.svg = make("svg", { height: HEIGHT, tabindex: 0, role: "img" }, host);
    this.tip = make("div", { class: "tip", hidden: "" }, host);
    this.listen();
  }

  listen() {
    const { svg } = this;
    svg.addEventListener("pointermove", (event) => this.point(event));
    svg.addEventListener("pointerdown", (event) => this.point(event));
    svg.addEventListener("pointerleave", (event) => {
      if (event.pointerType === "mouse") this.read(null); // a finger leaves at once; blur ends it
    });
    svg.addEventListener("click", () => this.setClock());
    svg.addEventListener("blur", () => this.read(null));
    svg.addEventListener("focus", () => {
      if (this.reading === null && svg.matches(":focus-visible")) this.read(this.first(), true);
    });
    svg.addEventListener("keydown", (event) => {
      const next = this.key(event);
      if (next === undefined) return;
      event.preventDefault();
      this.read(next, true);
    });
  }

  point(event) {
    const box = this.svg.getBoundingClientRect();
    this.read(this.nearest(event.clientX - box.left, event.clientY - box.top));
  }

  /** The position that a key moves to; undefined for other keys. */
  key({ key, shiftKey }) {
    const now = this.reading ?? this.first();
    if (key in this.arrows) return this.step(now, this.arrows[key], shiftKey);
    switch (key) {
      case "Home": return this.ends[0];
      case "End": return this.ends[1];
      case "Escape": return null;
      case "Enter": this.setClock(); return now;
    }
    return undefined;
  }

  /** Positions of the next step forward and backward. */
  arrows = { ArrowRight: 1, ArrowLeft: -1 };

  step(now, way, far) {
    const [first, last] = this.ends.map(this.x);
    return this.nearest(this.x(now) + (way * (last - first)) / (far ? 20 : 100));
  }

  /** The first and the last position that can be read. */
  get ends() {
    return [this.x.low, this.x.high];
  }

  /** The position at which reading with keys starts. */
  first() {
    return this.ends[0];
  }

  nearest(px) {
    return Math.min(this.x.high, Math.max(this.x.low, this.x.invert(px)));
  }

  /** Label of the horizontal axis. */
  across() {
    return this.panel.across;
  }

  setClock() {}

  shown(item) {
    return this.page.shown[item.plan] && (!item.machine || this.page.ghost);
  }

  /** Draw the panel, in the width of its host or a given width. */
  render(wide = this.host.clientWidth) {
    const width = Math.max(200, wide);
    this.size = { width, right: width - EDGE.right, bottom: HEIGHT - EDGE.bottom };
    this.svg.setAttribute("viewBox", `0 0 ${width} ${HEIGHT}`);
    this.svg.setAttribute("aria-label", this.label());
    this.svg.replaceChildren();
    this.scales();
    this.heading();
    this.frame();
    const clip = make("clipPath", { id: this.id }, this.svg);
    const plot = { x: EDGE.left, y: EDGE.top, width: this.size.right - EDGE.left };
    make("rect", { ...plot, height: this.size.bottom - EDGE.top }, clip);
    this.inside = make("g", { "clip-path": `url(#${this.id})` }, this.svg);
    this.over = make("g", {}, this.svg);
    this.draw();
    this.cursor = make("path", { class: "cursor" }, this.inside);
    this.cross = make("path", { class: "cross" }, this.inside);
    this.setCursor(this.clock);
    this.read(this.reading);
  }

  /** Title, unit and note; then names of the panel's own curves, bands and marks. */
  heading() {
    const { title, unit, note, series = [], band, marks = [], key = [] } = this.panel;
    const words = [unit, this.y.log && "log scale"].filter(Boolean).join(", ");
    this.head.replaceChildren(title);
    if (words) make("span", { class: "unit", text: ` (${words})` }, this.head);
    if (note) make("span", { class: "unit note", text: note }, this.head);
    const named = series.filter((s) => s.name && !s.other && !s.machine && this.shown(s)).map((s) => [this.swatch(s), s.name]);
    const swatch = (kind) => (kind === "path" ? this.swatch(series[0]) : make("span", { class: `swatch ${kind}` }));
    const entries = [...named, ...key.map(([kind, name]) => [swatch(kind), name])];
    if (band?.name) entries.push([make("span", { class: "swatch area" }), band.name]);
    if (named.length && marks.length) entries.push([make("span", { class: "swatch cross", text: "×" }), "leaves it"]);
    if (this.holds?.().length) entries.push([make("span", { class: "swatch hold" }), "the plan waits"]);
    this.notes.replaceChildren();
    for (const [swatch, name] of entries) make("span", { class: "entry" }, this.notes).append(swatch, name);
  }

  frame() {
    const { right, bottom } = this.size;
    axes(this.svg, this.x, this.y, { ...EDGE, right, bottom }, { percent: this.percent, across: this.across() });
  }

  /** Show values at a position (null: none); with `aloud` also to a screen reader. */
  read(place, aloud = false) {
    if (place !== this.reading) this.page.follow?.(this, place);
    this.reading = place;
    const told = place === null ? null : this.describe(place);
    if (!told || !told.rows.length) {
      this.tip.hidden = true;
      this.cross.setAttribute("d", "");
      return;
    }
    const { bottom, width } = this.size;
    this.cross.setAttribute("d", told.spot ?? `M${told.px} ${EDGE.top}V${bottom}`);
    this.tip.replaceChildren();
    make("div", { text: told.head }, this.tip);
    const table = make("table", { role: "presentation" }, this.tip);
    for (const row of told.rows.slice(0, MOST_ROWS)) {
      const line = make("tr", {}, table);
      const name = make("td", {}, line);
      name.append(this.swatch(row), this.named(row));
      make("td", { text: row.text }, line);
    }
    if (told.rows.length > MOST_ROWS)
      make("div", { text: `and ${told.rows.length - MOST_ROWS} more` }, this.tip);
    this.tip.hidden = false;
    const wide = this.tip.offsetWidth;
    const beside = told.px > width / 2 ? told.px - 12 - wide : told.px + 12;
    this.tip.style.left = `${Math.max(0, Math.min(width - wide, beside))}px`;
    const frame = this.svg.getBoundingClientRect(), hides = 2 * wide > width; // the figure it is about
    const down = hides ? frame.height : EDGE.top + 4;
    this.tip.style.top = `${frame.top - this.host.getBoundingClientRect().top + down}px`;
    if (aloud) {
      const rows = told.rows.map((r) => `${this.named(r)} ${r.text}`);
      this.page.say(`${told.head}: ${rows.join("; ")}`);
    }
  }

  /** A line at the time of the motion's clock, in figures over time. */
  setCursor(t) {
    this.clock = t;
  }

  /** Whether curves of several plans may cover each other. */
  get overlaps() {
    return ["time", "plane"].includes(this.panel.kind) && new Set(this.panel.series.map((s) => s.plan)).size > 1;
  }

  /** Name of an item (a series, a point, a row of values). */
  named(item) {
    return item.name ?? this.page.plans[item.plan].label;
  }

  classes(item, name) {
    const plan = this.page.plans[item.plan];
    const alone = !this.overlaps && styleOf(plan) === "followed";
    return `${name} plan-${item.colour ?? plan.colour} ${item.machine ? "machine" : ""} ${alone ? "" : styleOf(plan)}`;
  }

  swatch(item) {
    return make("span", { class: this.classes({ ...item, machine: false }, "swatch") });
  }
}

/** Ticks, numbers and lines of two axes around a box; `across` names the horizontal one. */
function axes(svg, x, y, box, { across, percent = false, square = false }) {
  const { left, right, top, bottom } = box;
  for (const value of ticks(y.low, y.high, square ? (bottom - top) / 50 : 5, y.log)) {
    const p = y(value);
    make("path", { class: value === 0 && !square ? "zero" : "grid", d: `M${left} ${p}H${right}` }, svg);
    const text = percent ? `${Math.round(100 * value)} %` : short(value, 3);
    make("text", { x: left - 7, y: p + 4, "text-anchor": "end", text }, svg);
  }
  for (const value of ticks(x.low, x.high, (right - left) / 75, x.log)) {
    const p = x(value);
    make("path", square ? { class: "grid", d: `M${p} ${top}V${bottom}` } : { class: "axis", d: `M${p} ${bottom}v4` }, svg);
    make("text", { x: p, y: bottom + 17, "text-anchor": "middle", text: short(value, 3) }, svg);
  }
  if (!square) make("path", { class: "axis", d: `M${left} ${bottom}H${right}` }, svg);
  const text = x.log ? `${across}, log scale` : across;
  make("text", { class: "across", x: right, y: bottom + 33, "text-anchor": "end", text }, svg);
}

/** Style of a plan's lines: its own, or with feedback dotted, refused dashed, below its compensated plan wide. */
function styleOf(plan) {
  return plan.style ?? (plan.closed ? "closed" : plan.refused ? "dashed" : plan.followed ? "followed" : "");
}

/** Least and greatest of finite numbers, with a margin to the frame. */
function range(lists, room = 0.06) {
  let low = Infinity;
  let high = -Infinity;
  for (const list of lists)
    for (const x of list)
      if (x !== null && x !== undefined) {
        low = Math.min(low, x);
        high = Math.max(high, x);
      }
  if (low > high) return [0, 1];
  const extra = (high - low || Math.abs(high) || 1) * room;
  return [low - extra, high + extra];
}
