// A figure over time: a curve for each plan.

class TimeChart extends Chart {
  scales() {
    const { panel, page } = this;
    const { right, bottom } = this.size;
    const visible = panel.series.filter((s) => this.shown(s));
    const list = visible.length ? visible : panel.series;
    const first = Math.min(...list.map((s) => s.t?.[0] ?? page.plans[s.plan].begin));
    const last = Math.max(...list.map((s) => s.t?.at(-1) ?? page.plans[s.plan].end));
    this.x = scale(first, last, EDGE.left, right);
    let span = panel.view;
    if (!span) {
      const ys = list.map((s) => s.y);
      if (panel.band) ys.push(panel.band.low, panel.band.high);
      ys.push(panel.ends ?? [], panel.limits ?? [], (panel.handles ?? []).map((p) => p.at[1]));
      if (panel.zero) ys.push([0]);
      span = range(ys);
    }
    this.y = scale(span[0], span[1], bottom, EDGE.top);
  }

  across() {
    const early = this.page.plans.some((plan) => plan.begin < 0);
    return early ? "time since the plan's start (s)" : "time (s)";
  }

  label() {
    const names = this.panel.series.filter((s) => !s.machine).map((s) => this.named(s));
    return `${this.panel.title} over time for ${names.join(", ")}. Arrow keys read values.`;
  }

  times(series) {
    const plan = this.page.plans[series.plan];
    return series.t ?? (series.machine ? plan.machine.t : plan.t);
  }

  draw() {
    const { panel, inside, over } = this;
    const { right } = this.size;
    for (const [begin, end] of this.holds()) {
      const height = this.size.bottom - EDGE.top;
      make("rect", { class: "hold", x: this.x(begin), y: EDGE.top, width: this.x(end) - this.x(begin), height }, inside);
    }
    if (panel.band) this.drawBand();
    if (panel.floor !== undefined) {
      const top = this.y(panel.floor);
      const height = Math.max(0, this.size.bottom - top);
      make("rect", { class: "below", x: EDGE.left, y: top, width: right - EDGE.left, height }, inside);
    }
    for (const limit of panel.limits ?? [])
      make("path", { class: "limit", d: `M${EDGE.left} ${this.y(limit)}H${right}` }, inside);
    for (const series of panel.series) {
      if (!this.shown(series)) continue;
      const xs = this.times(series).map(this.x);
      const ys = series.y.map((v) => (v === null ? null : this.y(v)));
      make("path", { class: this.classes(series, "curve"), d: path(xs, ys) }, inside);
    }
    for (const [t, z] of panel.marks ?? []) {
      const [x, y] = [this.x(t), this.y(z)];
      make("path", { class: "mark", d: `M${x - 5} ${y - 5}l10 10m0-10l-10 10` }, inside);
    }
    (panel.ends ?? []).forEach((value, k) => {
      if (value === null) return;
      const cx = k ? this.x(panel.until ?? this.x.high) : this.x(0);
      make("circle", { class: "end", cx, cy: this.y(value), r: 4 }, over);
    });
    for (const [t, value] of panel.stops ?? [])
      make("path", { class: "stop", d: diamond(this.x(t), this.y(value)) }, over);
    for (const { at: [t, value], names } of panel.handles ?? [])
      make("circle", { class: names ? "handle" : "handle fixed", cx: this.x(t), cy: this.y(value), r: 6 }, over);
    this.drawNotes();
  }

  /** Times at which a compensated plan's clock is held, if the panel shows only that plan. */
  holds() {
    const plans = new Set(this.panel.series.filter((s) => this.shown(s)).map((s) => s.plan));
    return plans.size === 1 ? (this.page.plans[[...plans][0]].holds ?? []) : [];
  }

  drawBand() {
    const { low, high } = this.panel.band;
    const t = this.times(this.panel.series[0]);
    const [xs, bottom, top] = [[], [], []];
    t.forEach((time, i) => {
      if (low[i] === null || high[i] === null) return;
      xs.push(this.x(time));
      bottom.push(this.y(low[i]));
      top.push(this.y(high[i]));
    });
    if (!xs.length) return;
    const back = path([...xs].reverse(), [...top].reverse()).replace("M", "L");
    make("path", { class: "band", d: `${path(xs, bottom)}${back}Z` }, this.inside);
    make("path", { class: "band-edge", d: path(xs, bottom) }, this.inside);
  }

  drawNotes() {
    const notes = (this.panel.notes ?? []).filter((n) => this.page.shown[n.plan]);
    for (const note of notes) {
      const { label, colour } = this.page.plans[note.plan];
      const text = `${label} peaks at ${short(note.value, 3)}, t = ${short(note.t, 2)} s`;
      make("span", { class: `plan-${colour}`, text }, this.notes);
      make("br", {}, this.notes);
      const up = note.value > 0;
      const [x, y] = [this.x(note.t), up ? EDGE.top : this.size.bottom];
      const d = up ? `M${x - 5} ${y + 9}l5-9l5 9Z` : `M${x - 5} ${y - 9}l5 9l5-9Z`;
      make("path", { class: `dot plan-${colour}`, d }, this.over);
    }
  }

  describe(t) {
    const rows = [];
    for (const series of this.panel.series) {
      if (!this.shown(series)) continue;
      const value = at(this.times(series), series.y, t);
      if (value === null) continue;
      const own = series.name ?? this.page.plans[series.plan].label;
      const name = series.machine ? `${own}, on the machine` : series.name;
      rows.push({ plan: series.plan, colour: series.colour, name, text: this.measured(value) });
    }
    if (this.panel.band && rows.length) {
      const { low, high } = this.panel.band;
      const times = this.times(this.panel.series[0]);
      const [a, b] = [at(times, low, t), at(times, high, t)];
      if (a !== null && b !== null)
        rows.push({ plan: this.panel.series[0].plan, name: this.panel.band.name ?? "domain", text: `${short(a, 3)} to ${short(b, 3)}` });
    }
    return { head: `${t.toFixed(2)} s`, rows, px: this.x(t) };
  }

  measured(value) {
    return this.panel.unit ? `${short(value)} ${this.panel.unit}` : short(value);
  }

  setClock() {
    if (this.reading !== null) this.page.setTime(this.reading);
  }

  setCursor(t) {
    super.setCursor(t);
    const inside = t !== null && this.x && t >= this.x.low && t <= this.x.high;
    this.cursor?.setAttribute("d", inside ? `M${this.x(t)} ${EDGE.top}V${this.size.bottom}` : "");
  }
}
