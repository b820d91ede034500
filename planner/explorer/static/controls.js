// Makes sliders, choices and switches from their descriptions; each calls `changed(name, value)`.

const STEPS = 1000;
const KEYS = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1, PageUp: 10, PageDown: -10 }; // in steps

function toSlider(c, value) {
  if (c.integer) return value;
  const share = c.log ? Math.log(value / c.low) / Math.log(c.high / c.low) : (value - c.low) / (c.high - c.low);
  return STEPS * share;
}

/** The value of a slider's position: one of its ends, or a round number. */
function fromSlider(c, raw) {
  if (c.integer) return raw;
  if (raw <= 0 || raw >= STEPS) return raw <= 0 ? c.low : c.high;
  const share = raw / STEPS;
  if (c.log) return Number((c.low * (c.high / c.low) ** share).toPrecision(3));
  const step = stepOf(c);
  return Math.min(c.high, Math.max(c.low, plus(Math.round((c.low + share * (c.high - c.low)) / step) * step, 0)));
}

/** A value rounded as the slider of a control rounds it, between its ends. */
function roundLike(c, value) {
  return fromSlider(c, toSlider(c, value));
}

/** The round number by which an arrow key moves a slider. */
function stepOf(c) {
  return c.integer ? 1 : roundStep(c.log ? c.low / 10 : (c.high - c.low) / 400);
}

/** The sum without rounding errors, so that a step back leads to where the step began. */
function plus(value, more) {
  return Number((value + more).toPrecision(12));
}

/** The row of a control, and attributes of its input; the label has the group, as "θ₁" is in two. */
function makeRow(c) {
  const row = make("div", { class: `px-row px-${c.kind}`, title: c.help });
  return [row, { "data-control": c.name, "aria-label": `${c.group}: ${c.label}` }];
}

function makeSlider(c, changed) {
  const [row, marks] = makeRow(c);
  const label = make("label", {}, row);
  const number = make("input", { type: "number", step: "any", "data-number": c.name, "aria-label": `${marks["aria-label"]}, number` }, row);
  make("span", { class: "px-unit", text: c.unit }, row);
  const input = make("input", { type: "range", min: 0, max: STEPS, step: c.integer ? 1 : "any", ...marks }, row);
  if (c.integer) [input.min, input.max] = [c.low, c.high];
  let now = c;
  let box = null;
  if (c.off_word) {
    const aloud = `${marks["aria-label"]}, set or ${c.off_word}`;
    box = make("input", { type: "checkbox", "data-switch": c.name, "aria-label": aloud }, label);
    box.onchange = () => changed(now.name, box.checked ? Number(now.shown.toPrecision(6)) : null);
  }
  const words = make("span", {}, label);
  const set = (value) => {
    now = { ...now, shown: value, on: true };
    show();
    changed(now.name, value);
  };
  let grabbed = false;
  let typing = false;
  input.onpointerdown = () => (grabbed = true);
  input.onpointerup = input.onpointercancel = () => (grabbed = false);
  input.oninput = () => set(fromSlider(now, Number(input.value)));
  number.oninput = () => (typing = true);
  const take = () => {
    if (!typing) return;
    typing = false;
    const value = Number(number.value);
    if (number.value === "" || !Number.isFinite(value)) show();
    else set(now.integer ? Math.min(now.high, Math.max(now.low, Math.round(value))) : value);
  };
  number.onchange = take;
  number.onblur = () => (typing = false);
  row.addEventListener("keydown", (event) => {
    const { key, target } = event;
    if (key === "Enter" && target === number) take(); // Jupyter keeps it from being a change
    if (!(key in KEYS) || target === box || (target === number && /Left|Right/.test(key))) return;
    event.preventDefault();
    const from = target === number && number.value !== "" ? Number(number.value) : now.shown;
    const value = plus(from, KEYS[key] * stepOf(now));
    typing = false;
    if (KEYS[key] > 0 ? value <= now.high : value >= now.low) set(value);
  });
  const show = () => {
    const text = now.shown === null ? "" : String(Number(now.shown.toPrecision(now.on ? 8 : 5)));
    if (!typing) number.value = text;
    input.value = toSlider(now, now.shown);
    words.textContent = now.on ? c.label : `${c.label} (${c.off_word})`;
    input.setAttribute("aria-valuetext", [text, c.unit, now.on ? "" : c.off_word].filter(Boolean).join(" "));
    if (box) box.checked = now.on;
    row.classList.toggle("px-off", !now.on);
  };
  const update = (next, held) => {
    if (held || grabbed) {
      now = { ...next, shown: now.shown, on: now.on };
      return;
    }
    now = next;
    if (c.integer) [input.min, input.max] = [now.low, now.high];
    show();
  };
  update(c, false);
  return { row, update };
}

function makeChoice(c, changed) {
  const [row, marks] = makeRow(c);
  make("label", { text: c.label }, row);
  const input = make("select", marks, row);
  for (const word of c.choices) input.append(new Option(word.replaceAll("_", " "), word));
  input.onchange = () => changed(c.name, input.value);
  const update = (next) => {
    input.value = next.shown;
    row.title = next.help;
  };
  update(c);
  return { row, update };
}

function makeSwitch(c, changed) {
  const [row, marks] = makeRow(c);
  const label = make("label", {}, row);
  const box = make("input", { type: "checkbox", ...marks }, label);
  label.append(c.label);
  box.onchange = () => changed(c.name, box.checked);
  const update = (next) => {
    box.checked = next.shown;
  };
  update(c);
  return { row, update };
}

// Shows all controls under their headings; rebuilds them only when the set of controls changes.
function makeControls(place, changed) {
  let shape = "";
  const open = { System: true, Start: true, Goal: true, Obstacles: true, Method: true, Limits: true };
  let made = new Map();
  const makers = { slider: makeSlider, choice: makeChoice, switch: makeSwitch };
  return (controls, held) => {
    const now = controls.map((c) => `${c.name}|${c.kind}|${c.choices}`).join();
    if (now !== shape) {
      shape = now;
      made = new Map();
      place.replaceChildren();
      for (const group of [...new Set(controls.map((c) => c.group))]) {
        const block = make("details", { class: "px-group" }, place);
        block.open = open[group] || false;
        block.ontoggle = () => (open[group] = block.open);
        make("summary", { text: group }, block);
        for (const c of controls.filter((c) => c.group === group)) {
          made.set(c.name, makers[c.kind](c, changed));
          block.append(made.get(c.name).row);
        }
      }
    }
    for (const c of controls) made.get(c.name).update(c, held.has(c.name));
  };
}
