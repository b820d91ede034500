// The motions of two plans (arms or vehicles) with a common clock.

/** Points or values at time t, interpolated linearly between samples. */
function between(motion, key, t) {
  const [a, b, s] = place(motion.t, Math.min(t, motion.t[motion.t.length - 1]));
  const mix = (p, q) => (Array.isArray(p) ? p.map((x, i) => mix(x, q[i])) : p + s * (q - p));
  return mix(motion[key][a], motion[key][b]);
}

class Stage {
  constructor(host, plans, chosen, page, bounds) {
    Object.assign(this, { plans, page, bounds, plan: plans[chosen] });
    this.host = make("div", { class: "stage" }, host);
    const label = make("label", {}, this.host);
    make("span", { class: "hidden", text: "Plan" }, label);
    this.select = make("select", {}, label);
    plans.forEach((plan, k) =>
      make("option", { value: k, text: plan.label + (plan.refused ? " (refused)" : "") }, this.select),
    );
    this.select.value = chosen;
    this.select.addEventListener("change", () => {
      this.plan = plans[this.select.value];
      this.render();
      this.move(this.t);
    });
    this.svg = make("svg", { role: "img" }, this.host);
    this.readout = make("p", { class: "readout" }, this.host);
    this.t = plans[chosen].begin;
  }

  render() {
    const { low, high } = this.bounds;
    const width = Math.max(120, this.host.clientWidth);
    const edge = { left: 34, right: 8, top: 8, bottom: 34 };
    const unit = (width - edge.left - edge.right) / (high[0] - low[0]);
    const bottom = edge.top + unit * (high[1] - low[1]);
    this.x = scale(low[0], high[0], edge.left, width - edge.right);
    this.y = scale(low[1], high[1], bottom, edge.top);
    this.svg.setAttribute("viewBox", `0 0 ${width} ${bottom + edge.bottom}`);
    this.svg.replaceChildren();
    const box = { ...edge, right: width - edge.right, bottom };
    axes(this.svg, this.x, this.y, box, { across: this.page.length, square: true });
    drawSpace(this.svg, this.page.space, this.x, this.y);
    const { colour, motion, path: way } = this.plan;
    for (const k of [0, motion.points.length - 1])
      make("path", { class: "ends", d: this.line(motion.points[k]) }, this.svg);
    const whole = this.line(way);
    const faint = { class: `curve plan-${colour}`, d: whole, "stroke-opacity": 0.3 };
    make("path", { ...faint, "stroke-width": 1 }, this.svg);
    this.trail = make("path", { class: `curve plan-${colour}` }, this.svg);
    this.body = make("path", { class: "body" }, this.svg);
    this.joints = motion.points[0].map((_, k) =>
      make("circle", { class: "joint", r: k ? 4 : 5.5 }, this.svg),
    );
    this.machine = make("path", { class: `machine-body plan-${colour}` }, this.svg);
  }

  line(points) {
    return path(points.map((p) => this.x(p[0])), points.map((p) => this.y(p[1])));
  }

  move(t) {
    this.t = t;
    const { motion, machine, path: way, t: times, label } = this.plan;
    const points = between(motion, "points", t);
    this.body.setAttribute("d", points.length > 1 ? this.line(points) : "");
    this.joints.forEach((joint, k) => {
      joint.setAttribute("cx", this.x(points[k][0]));
      joint.setAttribute("cy", this.y(points[k][1]));
    });
    let passed = 0;
    while (passed < times.length && times[passed] <= t) passed++;
    this.trail.setAttribute("d", this.line([...way.slice(0, passed), points[points.length - 1]]));
    const ghost = machine && this.page.ghost;
    this.machine.setAttribute("d", ghost ? this.line(between(machine, "points", t)) : "");
    this.tell(t, motion, ghost ? machine : null);
    this.svg.setAttribute("aria-label", `${label} at ${t.toFixed(2)} seconds`);
  }

  tell(t, motion, machine) {
    const values = between(motion, "values", t);
    const actual = machine && between(machine, "values", t);
    this.readout.replaceChildren();
    motion.names.forEach((name, k) => {
      const unit = motion.units[k] === "deg" ? "°" : ` ${motion.units[k]}`;
      const fixed = (x) => x.toFixed(motion.units[k] === "deg" ? 1 : 2).replace("-", "−");
      if (k) this.readout.append("  ");
      const item = make("span", { style: "white-space: nowrap" }, this.readout);
      item.append(`${name} `);
      make("b", { text: fixed(values[k]) + unit }, item);
      if (actual) item.append(` (${fixed(actual[k])})`);
      item.append(k < motion.names.length - 1 ? "," : "");
    });
  }
}

class Player {
  constructor(section, page) {
    const plans = page.plans.filter((plan) => plan.motion);
    if (!plans.length) return;
    section.hidden = false;
    const [begin, end] = [Math.min(...plans.map((p) => p.begin)), Math.max(...plans.map((p) => p.end))];
    Object.assign(this, { page, t: begin, playing: false, begin, end });
    const bounds = this.bounds(plans);
    const [w, h] = [0, 1].map((i) => bounds.high[i] - bounds.low[i]);
    const host = section.querySelector(".stages");
    if (w > 2 * h) host.classList.add("wide");
    const places = page.opening.map((label) => plans.findIndex((plan) => plan.label === label));
    const pair = places.filter((k) => k >= 0).slice(0, 2);
    this.stages = pair.map((k) => new Stage(host, plans, k, page, bounds));
    this.button = section.querySelector("#play");
    this.scrub = section.querySelector("#scrub");
    this.clock = section.querySelector("#clock");
    this.speed = section.querySelector("#speed");
    section.querySelector("#lead").hidden = begin >= 0;
    this.scrub.min = begin;
    this.scrub.max = end;
    this.scrub.step = (end - begin) / 200;
    this.button.addEventListener("click", () => this.toggle());
    this.scrub.addEventListener("input", () => {
      this.stop();
      this.set(Number(this.scrub.value));
    });
    const ghost = section.querySelector("#ghost");
    if (!plans.some((plan) => plan.machine)) section.querySelector("#ghost-label").hidden = true;
    ghost.addEventListener("change", () => page.showMachines(ghost.checked));
  }

  /** Bounding box of all motions. */
  bounds(plans) {
    const { discs, tips } = this.page.space;
    const corners = discs.flatMap(([x, y, r]) => [[x - r, y - r], [x + r, y + r]]);
    const moved = plans.flatMap((p) => [...p.path, ...p.motion.points.flat()]);
    const every = [...moved, ...corners, ...tips];
    const [xs, ys] = [0, 1].map((i) => range([every.map((q) => q[i])], 0.05));
    return { low: [xs[0], ys[0]], high: [xs[1], ys[1]] };
  }

  render() {
    for (const stage of this.stages ?? []) stage.render();
    if (this.stages) this.set(this.t);
  }

  set(t) {
    this.t = Math.min(this.end, Math.max(this.begin, t));
    for (const stage of this.stages) stage.move(this.t);
    this.scrub.value = this.t;
    const text = `${this.t.toFixed(2)} s`;
    this.scrub.setAttribute("aria-valuetext", text);
    this.clock.textContent = text;
    this.page.setCursor(this.t);
  }

  toggle() {
    if (this.playing) this.stop();
    else this.start();
  }

  stop() {
    this.playing = false;
    this.show("Play");
  }

  start() {
    if (this.t >= this.end) this.set(this.begin);
    this.playing = true;
    this.show("Pause");
    let last = performance.now();
    // If the user prefers reduced motion, show two still pictures per second.
    const calm = matchMedia("(prefers-reduced-motion: reduce)");
    const step = (now) => {
      if (!this.playing) return;
      if (!calm.matches || now - last >= 500) {
        this.set(this.t + ((now - last) / 1000) * Number(this.speed.value));
        last = now;
      }
      if (this.t >= this.end) this.stop();
      else requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }

  show(text) {
    this.button.textContent = text;
    this.button.setAttribute("aria-pressed", String(this.playing));
  }
}
