// The explorer in the browser: it sends the settings to Python and draws the answers.
//
// Only one request is pending at a time. Meanwhile, further settings are collected; the next request
// sends the newest value of each, so that a dragged slider never queues up work.

/** A figure whose handles can be dragged; calls `page.drag` with new values of the handle's controls. */
const draggable = (Base) =>
  class extends Base {
    listen() {
      super.listen();
      const { svg } = this;
      this.held = null;
      svg.addEventListener("pointerdown", (event) => {
        const box = svg.getBoundingClientRect();
        const [px, py] = [event.clientX - box.left, event.clientY - box.top];
        const far = ({ at }) => Math.hypot(this.x(at[0]) - px, this.y(at[1]) - py);
        const near = (this.panel.handles ?? []).filter((handle) => handle.names && far(handle) < 14);
        if (!near.length) return;
        near.sort((a, b) => far(a) - far(b));
        this.held = { handle: near[0], box, x: this.x, y: this.y }; // the axes may change meanwhile
        svg.setPointerCapture(event.pointerId);
        event.preventDefault();
      });
      for (const end of ["pointerup", "pointercancel"]) svg.addEventListener(end, () => (this.held = null));
    }

    point(event) {
      if (!this.held) return super.point(event);
      const { handle, box, x, y } = this.held;
      const at = [x.invert(event.clientX - box.left), y.invert(event.clientY - box.top)];
      this.page.drag(handle.names, this.values(handle, at));
    }
  };

class DragTime extends draggable(TimeChart) {
  holds() {
    return this.page.plans[0].holds ?? [];
  }

  values(_, [t, value]) {
    const { x } = this.held;
    const edge = 0.01 * (x.high - x.low);
    return [Math.min(Math.max(t, x.low + edge), x.high - edge), value];
  }
}

class DragPlane extends draggable(PlaneChart) {
  draw() {
    super.draw();
    for (const { at: [x, y] } of this.panel.handles ?? [])
      make("circle", { class: "handle grip", cx: this.x(x), cy: this.y(y), r: 4.5 }, this.over);
  }

  values({ pivot, zero }, [x, y]) {
    if (!pivot) return [x, y];
    const turned = (Math.atan2(y - pivot[1], x - pivot[0]) * 180) / Math.PI - zero;
    return [turned - 360 * Math.round(turned / 360)];
  }
}

const SOON = 250; // ms; a request that takes longer is shown as running and can be stopped
const LONG = 1000; // ms; after this time new settings stop the running plan instead of waiting
const PATIENCE = 10000; // ms; the kernel hears a request at once, and a stopped search should have answered by then
const KERNEL = {
  silent: "The kernel does not answer: perhaps another cell is running.",
  gone: "The kernel was restarted: run this cell again.",
};
const DOING = { judge: "verifying", errors: "on the machines", texts: "writing", mechanism: "drawing", second: "" };
const HELP = {
  "E 50 %": "largest error of an angle on the machine at any time, median of the machines",
  "end 50 %": "largest error of an angle on the machine at the end, median of the machines",
  sensitivity: "response of the passive joints at the end to the start of the first and the gain of the second motor, first order",
};
const MOST_KEPT = 3; // as many as there are styles of lines

function render({ model, el }) {
  const root = make("div", { class: "px charts" });
  // JupyterLab uses arrows and letters as shortcuts ("x" cuts the cell) unless the focused element forbids it.
  root.addEventListener("focusin", ({ target }) => target.setAttribute("data-lm-suppress-shortcuts", "true"));
  const side = make("div", { class: "px-side" }), main = make("div", { class: "px-main" });
  const head = make("div", { class: "px-head" }), verdict = make("span", { class: "px-verdict", role: "status" });
  const stopper = make("button", { type: "button", text: "Stop", "data-button": "stop", hidden: "" });
  const kernel = make("span", { class: "px-kernel", role: "status" });
  const facts = make("span", { class: "px-facts" }), words = make("div", { class: "px-words", tabindex: 0 });
  const grid = make("div", { class: "px-grid" }), texts = make("div", { class: "px-texts" });
  const live = make("div", { class: "px-live", "aria-live": "polite" });
  head.append(verdict, stopper, kernel, facts);
  const mechanism = make("div", { class: "px-mechanism", tabindex: 0, hidden: "" });
  const row = buttons();
  const table = make("div", { class: "px-table" });
  const tuning = make("div", { class: "px-tuning", tabindex: 0, hidden: "" });
  main.append(head, words, row, texts, table, tuning, mechanism, grid, live);
  root.append(side, main);
  el.append(root);

  const charts = new Map();
  const page = {
    plans: [],
    shown: [true],
    ghost: false, // the motion of the median machine
    say: (text) => (live.textContent = text),
    setTime: () => {},
    drag: (names, values) => names.forEach((name, k) => set(name, roundLike(settings.get(name), values[k]))),
    follow: (chart, t) => charts.forEach((other) => other !== chart && other.setCursor(t)),
  };
  let current = { plans: [], panels: [] }; // what the last answers showed of the plan
  let second = { label: "second plan", plans: [], panels: [] }, secondIs = "old"; // or "new", "off"
  let kept = [], keptBefore = 0;
  let barsBefore = []; // sensitivities of the plan that was on the screen before
  let panels = []; // what is drawn: the current plan with the others
  let settings = new Map(); // the controls by name
  let stale = false;
  let system = "", drawn = null; // constants of the current arm, and of the drawn mechanism
  let waiting = new Map(), busy = null, resting = 0, ticking = 0;
  let number = Math.floor(1e9 * Math.random()); // so that views of the same widget use different numbers

  const watch = new ResizeObserver((entries) => {
    for (const { target, contentRect } of entries) {
      const resized = charts.get(target.dataset.panel);
      const wide = Math.floor(contentRect.width);
      if (resized?.host === target && resized.wide !== wide) resized.render((resized.wide = wide));
    }
  });

  const fill = makeControls(make("div", {}, side), set);

  function set(name, value) {
    if (side.inert) return;
    cutSecond();
    if (!waiting.size) waiting.began = performance.now();
    root.dataset.open = 1;
    waiting.set(name, value);
    old();
    pump();
  }

  function pump() {
    if (busy || !waiting.size) return;
    const changes = [...waiting];
    begin("change", waiting.began, { changes });
    waiting = new Map();
  }

  function ask(kind) {
    if (!busy) begin(kind, performance.now());
  }

  function begin(kind, began, more = {}) {
    if (side.inert) return;
    clearTimeout(resting);
    busy = { kind, number: ++number, began, sent: performance.now(), heard: false, stopped: 0 };
    root.dataset.open = 1;
    if (!(kind in DOING)) old();
    clearInterval(ticking);
    ticking = setInterval(tick, 100);
    send({ ask: kind, number, ...more });
  }

  function send(content) {
    try {
      model.send(content);
    } catch {
      leave(); // after a restart of the kernel Jupyter refuses to send
    }
  }

  function connection(state) {
    kernel.textContent = KERNEL[state] ?? "";
    if (state) root.dataset.kernel = state;
    else delete root.dataset.kernel;
  }

  // The kernel was restarted and knows this page no more: the picture stays, what was asked for does not come.
  function leave() {
    clearTimeout(resting);
    clearInterval(ticking);
    connection("gone");
    if (!root.dataset.kind) verdict.textContent = facts.textContent = words.textContent = "";
    root.classList.remove("px-busy");
    busy = null;
    waiting.clear();
    side.inert = stopper.hidden = true;
  }

  // Remove the verdict: the picture no longer belongs to the current settings.
  function old() {
    delete root.dataset.kind;
    verdict.className = "px-verdict px-open";
    if (!root.classList.contains("px-busy")) verdict.textContent = "planning ...";
    for (const part of [facts, words]) part.classList.add("px-past");
    if (secondIs === "new") secondIs = "old";
    root.classList.add("px-moved");
  }

  function tick() {
    const ms = performance.now() - busy.began;
    if (ms < SOON) return;
    const { kind } = busy;
    const since = (moment) => performance.now() - moment;
    const silent = busy.heard ? busy.stopped && since(busy.stopped) > PATIENCE : since(busy.sent) > PATIENCE;
    connection(silent ? "silent" : undefined);
    const plans = !(kind in DOING);
    root.classList.toggle("px-busy", plans);
    charts.get("error")?.host.classList.toggle("px-past", plans || kind === "errors");
    if (kind === "second") table.querySelector(".px-second th")?.setAttribute("data-doing", ` planning, ${Math.floor(ms / 1000)} s`);
    if (plans) words.textContent = facts.textContent = "";
    if (plans || root.dataset.kind === "not judged yet") {
      const doing = busy.stopped ? "stopping" : (DOING[kind] ?? "planning");
      verdict.textContent = `${doing}, ${Math.floor(ms / 1000)} s`;
    }
    stopper.hidden = kind === "texts" || kind === "mechanism";
    if (plans && waiting.size && ms > LONG) stop(true); // its answer would belong to other settings
  }

  function stop(atOnce) {
    if (!busy || stopper.disabled || (busy.stopped && !atOnce)) return;
    busy.stopped ||= performance.now();
    stopper.disabled = atOnce;
    stopper.textContent = "Stop now"; // without refining the best plan found so far
    send({ ask: "stop", number: busy.number, at_once: atOnce });
  }

  function answered(reply) {
    if (!busy || reply.number !== busy.number) return;
    if (reply.heard) return (busy.heard = true);
    if (reply.controls) {
      settings = new Map(reply.controls.map((c) => [c.name, c]));
      fill(reply.controls, new Set(waiting.keys()));
      press();
    }
    if (reply.more) return;
    const done = busy;
    busy = null;
    clearInterval(ticking);
    connection();
    stopper.hidden = true;
    stopper.disabled = false;
    stopper.textContent = "Stop";
    root.classList.remove("px-busy");
    if (reply.panels) {
      const { plans, panels } = reply;
      if (panels.length) current = { ...current, label: plans[0].label, plans, panels };
      root.classList.toggle("px-stale", !reply.panels.length);
      charts.get("error")?.host.classList.toggle("px-past", reply.todo?.includes("errors") ?? false);
    }
    if (reply.error !== undefined) {
      charts.get("error")?.host.classList.remove("px-past");
      const { error, machine, row, why, bars } = reply;
      if (JSON.stringify(bars) !== JSON.stringify(current.bars ?? [])) barsBefore = current.bars ?? [];
      current = { ...current, error, machine, row, why, bars };
      if (why) tell();
      root.classList.remove("px-moved");
    }
    if (done.kind === "second" && !done.cut) [second, secondIs] = [reply.second ?? second, "new"];
    if (reply.system !== undefined) {
      system = reply.system;
      row.querySelector("[data-button=mechanism]").hidden = !system;
      if (!system) mechanism.hidden = true;
    }
    if (reply.mechanism !== undefined) showMechanism(reply);
    if (reply.kind) say(reply);
    if (reply.code !== undefined) showTexts(reply);
    if (reply.panels || reply.error !== undefined || reply.second) redraw();
    if (done.kind === "change") root.dataset.pictureMs = Math.round(performance.now() - done.began);
    root.dataset.open = waiting.size + (reply.todo ? reply.todo.length : 0) + (secondIs === "old");
    root.dataset.stage = done.kind;
    root.dataset.number = done.number;
    if (done.kind === "change" || done.kind === "reset") stale = texts.childElementCount > 0;
    if (waiting.size) {
      old();
      pump();
    } else next(reply, done.cut);
  }

  // When the sliders rest, request the remaining steps: the errors, then the verdict.
  function next(reply, cut) {
    clearTimeout(resting);
    if (!reply.todo || !reply.todo.length) {
      if (stale) ask("texts"); // open code and problem file are updated too
      else if (!mechanism.hidden && system !== drawn) ask("mechanism");
      else if (secondIs === "old" && !cut) ask("second");
      return;
    }
    const dragged = [...charts.values()].some((chart) => chart.held);
    resting = setTimeout(() => ask(reply.todo[0]), dragged ? 120 : 0);
  }

  function say(reply) {
    const { kind } = reply;
    const open = kind === "not judged yet";
    const word = { verified: "good", "not judged yet": "open", stopped: "open" }[kind] ?? "bad";
    verdict.className = `px-verdict px-${word}`;
    verdict.textContent = open ? "verifying ..." : kind === "stopped" ? "stopped: no plan" : word === "good" ? kind : `refused: ${kind}`;
    words.textContent = reply.text;
    current.facts = reply.facts;
    tell();
    for (const part of [facts, words]) part.classList.remove("px-past");
    root.dataset.kind = kind;
    for (const plan of current.plans) plan.refused = word === "bad" || kind === "stopped";
    current.kind = kind;
    if (!reply.panels) redraw();
  }

  function tell() {
    facts.textContent = [current.facts, current.why && `no replay: ${current.why}`].filter(Boolean).join(", ");
  }

  /** The plans beside the current one: the second plan, and those that were kept. */
  function others() {
    return [...(secondIs === "off" ? [] : [second]), ...kept];
  }

  /** Put the curves of the other plans and of the machine into the current plan's panels. */
  function compose() {
    const beside = others().filter((one) => one.plans.length);
    page.plans = [...current.plans, ...beside.map((one) => ({ ...one.plans[0], style: lineOf(one) }))];
    page.shown = page.plans.map(() => true);
    panels = [...current.panels, ...(current.error ? [current.error] : [])].map((panel) => {
      const found = beside.map((one, k) => [one, k + 1, [...one.panels, one.error].find((p) => p?.id === panel.id)]);
      const more = found.filter(([, , other]) => other);
      const series = [...panel.series];
      for (const s of panel.series) {
        const { t, names = [], values } = current.machine ?? {};
        const place = panel.id.startsWith("joints") ? names.indexOf(s.name) : -1;
        if (place >= 0) series.push({ ...s, t, y: values.map((row) => row[place]), machine: true });
      }
      for (const [one, plan, other] of more)
        series.push(...other.series.map((s) => ({ ...s, plan, other: true, name: s.name && `${s.name}, ${one.label}` })));
      const handles = panel.handles?.filter(({ names }) => !names || names.every((name) => settings.has(name)));
      return { ...panel, series, handles, view: widest([panel.view, ...more.map(([, , other]) => other.view)]), until: page.plans[0].end };
    });
  }

  /** The range, or the ranges of both axes, with room for all; undefined where any has none. */
  function widest(views) {
    if (views.some((view) => !view)) return undefined;
    if (Array.isArray(views[0][0])) return [0, 1].map((k) => widest(views.map((view) => view[k])));
    return [Math.min(...views.map((v) => v[0])), Math.max(...views.map((v) => v[1]))];
  }

  function lineOf(one) {
    return one === second ? "beside beside-0" : `beside beside-${1 + kept.indexOf(one)}`;
  }

  /** A row of figures for each plan; they belong to the curves of the same style. */
  function tabulate() {
    table.replaceChildren();
    const every = [current, ...others()];
    const titles = every.map((one) => one.row ?? []).find((row) => row.length) ?? [];
    const whole = make("table", {}, table);
    const top = make("tr", {}, make("thead", {}, whole));
    make("th", { text: "plan" }, top);
    for (const [title, unit] of titles) {
      const cell = make("th", { text: title, title: HELP[title] ?? "" }, top);
      if (unit) make("span", { class: "px-unit", text: ` ${unit}` }, cell);
    }
    const body = make("tbody", {}, whole);
    for (const one of every) {
      const line = make("tr", { class: one === second ? "px-second" : one === current ? "px-current" : "px-kept" }, body);
      const name = make("th", {}, line);
      const plan = one.plans[0];
      const style = one === current ? (plan?.refused ? "dashed" : "") : lineOf(one);
      if (plan) make("span", { class: `swatch plan-${plan.colour} ${style}` }, name);
      name.append(one.label ?? "");
      const open = !one.kind || one.kind === "not judged yet";
      if (!open && one.kind !== "verified") make("span", { class: "px-bad", text: ` ${one.kind}`, title: one.text ?? "" }, name);
      if (kept.includes(one)) {
        const label = `Drop ${one.label}`;
        const drop = make("button", { type: "button", text: "×", "data-button": "drop", "aria-label": label, title: label }, name);
        drop.onclick = () => redraw((kept = kept.filter((other) => other !== one)));
      }
      titles.forEach((_, k) => make("td", { text: one.row?.[k] ? short(one.row[k][2], 3) : "–" }, line));
    }
  }

  /** A bar for each error and plan: how far the error moves the end; a line where it was before. */
  function drawBars() {
    tuning.replaceChildren();
    if (tuning.hidden) return;
    const every = [current, ...others()].filter((one) => one.bars?.length);
    const note = "how far each error alone, of its usual size, moves the angles at the end (deg, first order)";
    make("p", { class: "px-note", text: every.length ? `Sensitivity: ${note}; the line: before the last change.` : "No sensitivity without a motion." }, tuning);
    if (!every.length) return;
    const names = [...new Set(every.flatMap((one) => one.bars.map(([name]) => name)))];
    const value = (bars, name) => bars?.find((bar) => bar[0] === name)?.[2];
    const most = Math.max(...names.flatMap((name) => [...every.map((one) => one.bars), barsBefore].map((bars) => value(bars, name) ?? 0)), 1e-9);
    for (const name of names) {
      const size = every.map((one) => one.bars.find((bar) => bar[0] === name)?.[1]).find(Boolean);
      const block = make("div", { class: "px-error" }, tuning);
      make("span", { class: "px-name", text: `${name} (${size})` }, block);
      const bars = make("div", {}, block);
      for (const one of every) {
        const end = value(one.bars, name);
        if (end === undefined) continue;
        const line = make("div", { class: "px-bar", title: one.label ?? "" }, bars);
        const plan = one.plans[0];
        const place = make("span", { class: "px-place" }, line);
        const bar = make("span", { class: `px-fill plan-${plan?.colour ?? 0} ${one === current ? "" : "px-other"}` }, place);
        bar.style.width = `${(100 * end) / most}%`;
        const before = one === current ? value(barsBefore, name) : undefined;
        if (before !== undefined) make("span", { class: "px-before" }, place).style.left = `${(100 * before) / most}%`;
        make("span", { text: `${short(end, 3)} ${one === current ? "" : one.label ?? ""}` }, line);
      }
    }
  }

  function redraw() {
    if (!current.plans.length) return;
    compose();
    tabulate();
    drawBars();
    const ids = panels.map((panel) => panel.id);
    if ([...charts.keys()].join() !== ids.join()) {
      grid.replaceChildren();
      for (const panel of panels) {
        if (!charts.has(panel.id)) charts.set(panel.id, chart(panel));
        grid.append(charts.get(panel.id).host);
      }
      for (const id of [...charts.keys()]) if (!ids.includes(id)) charts.delete(id);
    }
    for (const panel of panels) {
      const drawn = charts.get(panel.id);
      drawn.panel = panel;
      drawn.render(drawn.wide); // pass the known width; measuring it would force a layout of the page
    }
  }

  function chart(panel) {
    const host = make("div", { class: "panel" });
    host.dataset.panel = panel.id;
    watch.observe(host);
    return new { time: DragTime, plane: DragPlane }[panel.kind](host, panel, page);
  }

  function buttons() {
    const row = make("div", { class: "px-buttons" });
    const actions = { keep, second: toggleSecond, machine: toggleMachine, feedback: toggleFeedback, code: showText, file: showText, mechanism: toggleMechanism, tuning: toggleTuning, reset };
    const words = { keep: "Keep this curve", second: "Second plan", machine: "Machine", feedback: "Feedback", tuning: "Sensitivity", code: "Python code", file: "Problem file", mechanism: "Mechanism", reset: "Reset" };
    for (const [kind, text] of Object.entries(words))
      make("button", { type: "button", text, "data-button": kind }, row).onclick = () => actions[kind](kind);
    return row;
  }

  /** Hold the plan on the screen beside later ones; the oldest makes room. */
  function keep() {
    if (!current.plans.length) return;
    const label = `kept ${++keptBefore}: ${current.label}`;
    kept = [...kept, { ...current, label }].slice(-MOST_KEPT);
    redraw();
  }

  function toggleSecond() {
    cutSecond();
    secondIs = secondIs === "off" ? "old" : "off";
    press();
    redraw();
    if (secondIs === "old") whenFree(() => secondIs === "old" && ask("second"));
  }

  function toggleMachine() {
    page.ghost = !page.ghost;
    press();
    redraw();
  }

  function toggleFeedback() {
    if (settings.has("feedback")) set("feedback", !settings.get("feedback").shown);
  }

  function reset() {
    waiting.clear();
    if (busy && !(busy.kind in DOING)) stop(true);
    whenFree(() => ask("reset"));
  }

  function toggleTuning() {
    tuning.hidden = !tuning.hidden;
    drawBars();
    press();
  }

  function toggleMechanism() {
    mechanism.hidden = !mechanism.hidden;
    if (!mechanism.hidden && system !== drawn) whenFree(() => ask("mechanism"));
    press();
  }

  /** Show the code or the file beside the buttons; the button of the text shown hides it. */
  function showText(kind) {
    const shown = texts.childElementCount > 0 && texts.dataset.wanted === kind;
    texts.dataset.wanted = shown ? "" : kind;
    if (!shown) return whenFree(() => ask("texts"));
    stale = false;
    texts.replaceChildren();
    press();
  }

  /** Mark the buttons whose content is open. */
  function press() {
    const open = { second: secondIs !== "off", machine: page.ghost, feedback: settings.get("feedback")?.shown ?? false, code: texts.dataset.wanted === "code", file: texts.dataset.wanted === "file", mechanism: !mechanism.hidden, tuning: !tuning.hidden };
    for (const [kind, pressed] of Object.entries(open))
      row.querySelector(`[data-button=${kind}]`).setAttribute("aria-pressed", pressed);
  }

  /** End the second plan's search for a request of the user; it is asked for again later. */
  function cutSecond() {
    if (busy?.kind !== "second") return;
    busy.cut = true;
    stop(true);
  }

  function whenFree(act) {
    cutSecond();
    if (busy || waiting.size) setTimeout(() => whenFree(act), 20);
    else {
      clearTimeout(resting);
      act();
    }
  }

  function showMechanism(reply) {
    drawn = reply.drawn;
    const src = `data:image/svg+xml;charset=utf-8,${encodeURIComponent(reply.mechanism)}`;
    mechanism.replaceChildren(make("img", { alt: "the arm's mechanism", src }));
  }

  function showTexts(reply) {
    stale = false;
    if (!texts.dataset.wanted) return;
    if (!texts.childElementCount) {
      const copy = make("button", { type: "button", text: "Copy", "data-button": "copy" }, texts);
      make("textarea", { readonly: "", "aria-label": "the settings as text" }, texts);
      copy.onclick = () => {
        const area = texts.querySelector("textarea");
        area.select();
        if (navigator.clipboard) navigator.clipboard.writeText(area.value);
        else document.execCommand("copy");
        copy.textContent = "Copied";
      };
    }
    const [copy, area] = texts.children;
    copy.textContent = "Copy";
    area.value = reply[texts.dataset.wanted];
    area.rows = Math.min(18, area.value.split("\n").length);
    press();
  }

  model.on("msg:custom", answered);
  model.on("comm_live_update", leave); // Jupyter's word, at once, that the kernel was restarted
  stopper.onclick = () => stop(Boolean(busy?.stopped));
  ask("picture");
  return () => {
    clearTimeout(resting);
    clearInterval(ticking);
    watch.disconnect();
    model.off("msg:custom", answered);
    model.off("comm_live_update", leave);
  };
}

export default { render };
