// What every figure shares: frame, axes, legend, reading of values by pointer and keys.

const EDGE = { left: 50, right: 12, top: 8, bottom: 38 };
const HEIGHT = 220;
let charts = 0;

class Chart {
  /**
   * @param host element to draw into
   * @param panel what to draw: kind, title, unit, series or points
   * @param page plans, which are shown, whether machines are, and the clock's setter
   */
  constructor(host, panel, page) {
    Object.assign(this, { host, panel, page, reading: null, clock: null });
    this.id = `chart-${++charts}`;
    const head = make("h3", { text: panel.title, id: `${this.id}-title` }, host);
    if (panel.unit) make("span", { class: "unit", text: ` (${panel.unit})` }, head);
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

  /** Where the keys lead; undefined for keys that mean nothing here. */
  key(event) {
    const { low, high } = this.x;
    const now = this.reading ?? this.first();
    const f = (x) => Math.min(high, Math.max(low, x));
    const a = this.x(low);
    const span = this.x(high) - a;
    const step = (n) => f(this.x.invert(this.x(now) + (n * span) / (event.shiftKey ? 20 : 100)));
    switch (event.key) {
      case "ArrowRight": return step(1);
      case "ArrowLeft": return step(-1);
      case "Home": return low;
      case "End": return high;
      case "Escape": return null;
      case "Enter": this.setClock(); return now;
    }
    return undefined;
  }

  first() {
    return this.x.low;
  }

  nearest(px) {
    return Math.min(this.x.high, Math.max(this.x.low, this.x.invert(px)));
  }

  setClock() {}

  shown(item) {
    return this.page.shown[item.plan] && (!item.machine || this.page.ghost);
  }

  render() {
    const width = Math.max(200, this.host.clientWidth);
    this.size = { width, right: width - EDGE.right, bottom: HEIGHT - EDGE.bottom };
    this.svg.setAttribute("viewBox", `0 0 ${width} ${HEIGHT}`);
    this.svg.setAttribute("aria-label", this.label());
    this.svg.replaceChildren();
    this.scales();
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

  frame() {
    const { right, bottom } = this.size;
    for (const y of ticks(this.y.low, this.y.high, 5, this.y.log)) {
      const p = this.y(y);
      make("path", { class: y === 0 ? "zero" : "grid", d: `M${EDGE.left} ${p}H${right}` }, this.svg);
      const text = this.percent ? `${Math.round(100 * y)} %` : short(y, 3);
      make("text", { x: EDGE.left - 7, y: p + 4, "text-anchor": "end", text }, this.svg);
    }
    const count = (right - EDGE.left) / 75;
    for (const x of ticks(this.x.low, this.x.high, count, this.x.log)) {
      const p = this.x(x);
      make("path", { class: "axis", d: `M${p} ${bottom}v4` }, this.svg);
      make("text", { x: p, y: bottom + 17, "text-anchor": "middle", text: short(x, 3) }, this.svg);
    }
    make("path", { class: "axis", d: `M${EDGE.left} ${bottom}H${right}` }, this.svg);
    const words = { x: right, y: bottom + 33, "text-anchor": "end", text: this.across() };
    make("text", words, this.svg);
  }

  /** Show values at a place (null: none); `aloud` tells them to a screen reader too. */
  read(place, aloud = false) {
    this.reading = place;
    const told = place === null ? null : this.describe(place);
    if (!told || !told.rows.length) {
      this.tip.hidden = true;
      this.cross.setAttribute("d", "");
      return;
    }
    const { bottom, width } = this.size;
    this.cross.setAttribute("d", `M${told.px} ${EDGE.top}V${bottom}`);
    this.tip.replaceChildren();
    make("div", { text: told.head }, this.tip);
    const table = make("table", { role: "presentation" }, this.tip);
    for (const row of told.rows) {
      const line = make("tr", {}, table);
      const name = make("td", {}, line);
      name.append(this.page.swatch(row.plan), row.name ?? this.page.plans[row.plan].label);
      make("td", { text: row.text }, line);
    }
    this.tip.hidden = false;
    const wide = this.tip.offsetWidth;
    const beside = told.px > width / 2 ? told.px - 12 - wide : told.px + 12;
    this.tip.style.left = `${Math.max(0, Math.min(width - wide, beside))}px`;
    this.tip.style.top = `${this.svg.offsetTop + EDGE.top + 4}px`;
    if (aloud) {
      const rows = told.rows.map((r) => `${r.name ?? this.page.plans[r.plan].label} ${r.text}`);
      this.page.say(`${told.head}: ${rows.join("; ")}`);
    }
  }

  /** A line at the time of the motion's clock, where the figure has time. */
  setCursor(t) {
    this.clock = t;
  }

  classes(item, name) {
    const plan = this.page.plans[item.plan];
    return `${name} plan-${plan.colour} ${item.machine ? "machine" : ""} ${styleOf(plan)}`;
  }
}

/** How a plan's lines are drawn: with feedback dotted, refused dashed. */
function styleOf(plan) {
  return plan.closed ? "closed" : plan.refused ? "dashed" : "";
}

/** Least and greatest of finite numbers, a little apart from the frame. */
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
