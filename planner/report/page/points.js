// The figure with a point for each plan: effort against error.

class PointsChart extends Chart {
  scales() {
    const some = this.panel.points.filter((p) => this.shown(p));
    const list = some.length ? some : this.panel.points;
    const axis = (values, a, b, room) => {
      const [low, high] = [Math.min(...values), Math.max(...values)];
      const log = low > 0 && high / low > 5;
      return log ? scale(low / 1.5, high * room, a, b, true) : scale(0, high * room || 1, a, b);
    };
    this.x = axis(list.map((p) => p.x), EDGE.left, this.size.right, 1.6);
    this.y = axis(list.flatMap((p) => [p.y, p.high]), this.size.bottom, EDGE.top, 1.15);
    this.places = list;
  }

  across() {
    return "effort";
  }

  label() {
    const said = this.panel.points.map(
      (p) => `${this.page.plans[p.plan].label}: effort ${short(p.x)}, E ${short(p.y, 3)} degrees`,
    );
    return `Effort against error. ${said.join("; ")}. Arrow keys go from plan to plan.`;
  }

  draw() {
    for (const point of this.places) {
      if (!this.shown(point)) continue;
      const [x, y] = [this.x(point.x), this.y(point.y)];
      make("path", { class: this.classes(point, "bar"), d: `M${x} ${y}V${this.y(point.high)}` }, this.over);
      make("circle", { class: this.classes(point, "dot"), cx: x, cy: y, r: 6 }, this.over);
    }
    this.drawNames();
  }

  /** The plans' names beside their points, moved apart where they would meet. */
  drawNames() {
    const list = this.places.filter((p) => this.shown(p)).sort((a, b) => this.y(a.y) - this.y(b.y));
    const ends = { start: -Infinity, end: -Infinity };
    for (const point of list) {
      const text = this.page.plans[point.plan].label;
      const wide = 7 * text.length + 14;
      const [px, py] = [this.x(point.x), this.y(point.y)];
      const beside = (p, way) => p !== point && Math.abs(this.y(p.y) - py) < 14 && way(this.x(p.x) - px);
      const fits = {
        start: px + wide < this.size.width && !list.some((p) => beside(p, (d) => d >= 0 && d < wide)),
        end: px - wide > EDGE.left && !list.some((p) => beside(p, (d) => d <= 0 && -d < wide)),
      };
      const anchor = fits.start || !fits.end ? "start" : "end";
      const clear = fits[anchor] ? py + 4 : py + 22;
      const y = Math.max(clear, ends[anchor] + 14);
      ends[anchor] = y;
      const x = px + (anchor === "start" ? 11 : -11);
      const inside = anchor === "start" ? Math.min(x, this.size.width - wide + 12) : x;
      const style = { class: `name plan-${this.page.plans[point.plan].colour}`, "text-anchor": anchor };
      make("text", { x: inside, y, text, ...style }, this.over);
    }
  }

  nearest(px, py) {
    const far = (p) => Math.hypot(this.x(p.x) - px, this.y(p.y) - py);
    const list = this.places.filter((p) => this.shown(p));
    return list.length ? list.reduce((a, b) => (far(b) < far(a) ? b : a)) : null;
  }

  first() {
    return this.places[0];
  }

  key(event) {
    const list = this.places.filter((p) => this.shown(p));
    const k = Math.max(0, list.indexOf(this.reading));
    switch (event.key) {
      case "ArrowRight": case "ArrowDown": return list[Math.min(k + 1, list.length - 1)];
      case "ArrowLeft": case "ArrowUp": return list[Math.max(k - 1, 0)];
      case "Home": return list[0];
      case "End": return list[list.length - 1];
      case "Escape": return null;
    }
    return undefined;
  }

  describe(point) {
    const of = (name, text) => ({ plan: point.plan, name, text });
    const { unit } = this.panel;
    return {
      head: this.page.plans[point.plan].label,
      rows: [
        of("effort", short(point.x)),
        of("median of E", `${short(point.y, 3)} ${unit}`),
        of("95th percentile", `${short(point.high, 3)} ${unit}`),
      ],
      px: this.x(point.x),
    };
  }
}
