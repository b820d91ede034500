// Makes sliders, choices and switches from their descriptions; each calls `changed(name, value)`.

const STEPS = 1000;

function toSlider(c, value) {
  if (c.integer) return value;
  const share = c.log ? Math.log(value / c.low) / Math.log(c.high / c.low) : (value - c.low) / (c.high - c.low);
  return Math.round(STEPS * share);
}

function fromSlider(c, raw) {
  if (c.integer) return raw;
  const share = raw / STEPS;
  return c.log ? c.low * (c.high / c.low) ** share : c.low + share * (c.high - c.low);
}

function readable(c) {
  if (c.shown === null) return "";
  return [short(c.shown), c.unit, c.on ? "" : `(${c.off_word})`].filter(Boolean).join(" ");
}

/** The row of a control, and attributes of its input; the label has the group, as "θ₁" is in two. */
function makeRow(c) {
  const row = make("div", { class: "px-row", title: c.help });
  return [row, { "data-control": c.name, "aria-label": `${c.group}: ${c.label}` }];
}

function makeSlider(c, changed) {
  const [row, marks] = makeRow(c);
  const label = make("label", { text: c.label }, row);
  const input = make("input", { type: "range", min: 0, max: STEPS, step: 1, ...marks }, row);
  if (c.integer) [input.min, input.max] = [c.low, c.high];
  const value = make("output", {}, row);
  let now = c;
  let box = null;
  if (c.off_word) {
    const aloud = `${marks["aria-label"]}, set or ${c.off_word}`;
    box = make("input", { type: "checkbox", "data-switch": c.name, "aria-label": aloud });
    box.onchange = () => changed(now.name, box.checked ? now.shown : null);
    label.prepend(box);
  }
  let grabbed = false;
  input.onpointerdown = () => (grabbed = true);
  input.onpointerup = input.onpointercancel = () => (grabbed = false);
  input.oninput = () => {
    now = { ...now, shown: fromSlider(now, Number(input.value)), on: true };
    show();
    changed(now.name, now.shown);
  };
  const show = () => {
    value.textContent = readable(now);
    input.setAttribute("aria-valuetext", value.textContent);
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
    input.value = toSlider(now, now.shown);
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
  const open = { System: true, Start: true, Goal: true, Method: true, Limits: true };
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
