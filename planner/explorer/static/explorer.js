// The explorer in the browser: sends what is set, draws what comes back.
//
// One question is under way at a time. While it is, further settings are gathered and the newest
// of each goes out with the next question, so that a dragged slider never queues up work.

function render({ model, el }) {
  const root = element("div", "px");
  const side = element("div", "px-side"), main = element("div", "px-main");
  const verdict = element("div", "px-verdict"), words = element("pre", "px-words");
  const facts = element("div", "px-facts"), grid = element("div", "px-grid");
  const texts = element("div", "px-texts");
  verdict.setAttribute("role", "status");
  main.append(verdict, words, facts, grid, texts);
  root.append(side, main);
  el.append(root);

  const canvases = new Map();
  let panels = [], frames = new Map();
  let stale = false;
  let waiting = new Map(), busy = null, resting = 0, dragged = null;
  let number = Math.floor(1e9 * Math.random()); // another view of the same widget counts elsewhere

  const controlsPlace = element("div");
  const fill = makeControls(controlsPlace, (name, value) => set(name, value));
  side.append(controlsPlace, buttons());

  function set(name, value) {
    if (!waiting.size) waiting.began = performance.now();
    root.dataset.open = 1;
    waiting.set(name, value);
    pump();
  }

  function pump() {
    if (busy || !waiting.size) return;
    clearTimeout(resting);
    busy = { kind: "change", number: ++number, began: waiting.began };
    const changes = [...waiting];
    waiting = new Map();
    model.send({ ask: "change", number, changes });
  }

  function ask(kind) {
    if (busy) return;
    busy = { kind, number: ++number, began: performance.now() };
    model.send({ ask: kind, number });
  }

  function answered(reply) {
    if (!busy || reply.number !== busy.number) return;
    const done = busy;
    busy = null;
    if (reply.panels) {
      const kept = reply.error === undefined ? panels.filter((p) => p.id === "error") : [];
      if (reply.panels.length) panels = [...reply.panels, ...kept];
      root.classList.toggle("px-stale", !reply.panels.length);
      fill(reply.controls, new Set(waiting.keys()));
    }
    if (reply.error !== undefined) {
      panels = panels.filter((p) => p.id !== "error");
      if (reply.error) panels.push(reply.error);
    }
    if (reply.kind) say(reply);
    if (reply.code !== undefined) showTexts(reply);
    if (reply.panels || reply.error !== undefined) redraw();
    root.dataset.ms = Math.round(performance.now() - done.began);
    if (done.kind === "change") [root.dataset.pictureMs, root.dataset.kernelMs] = [root.dataset.ms, reply.took_ms];
    root.dataset.open = waiting.size + (reply.todo ? reply.todo.length : 0);
    root.dataset.stage = done.kind;
    root.dataset.number = done.number;
    if (done.kind === "change" || done.kind === "reset") stale = texts.childElementCount > 0;
    if (waiting.size) pump();
    else next(reply);
  }

  // What is still open once the sliders rest: the errors, then the verdict.
  function next(reply) {
    clearTimeout(resting);
    if (!reply.todo || !reply.todo.length) {
      if (stale) ask("texts"); // the text that is open follows the picture
      return;
    }
    resting = setTimeout(() => ask(reply.todo[0]), dragged ? 120 : 0);
  }

  function say(reply) {
    const good = reply.kind === "verified";
    verdict.className = `px-verdict px-${good ? "good" : reply.kind === "not judged yet" ? "open" : "bad"}`;
    verdict.textContent = good ? "verified" : reply.kind === "not judged yet" ? "verifying ..." : `refused: ${reply.kind}`;
    words.textContent = reply.text;
    facts.textContent = reply.facts;
    root.dataset.kind = reply.kind;
    for (const panel of panels) panel.refused = !good && reply.kind !== "not judged yet";
    if (!reply.panels) redraw();
  }

  function redraw() {
    const ids = panels.map((p) => p.id);
    if ([...canvases.keys()].join() !== ids.join()) {
      grid.replaceChildren();
      for (const id of ids) {
        if (!canvases.has(id)) canvases.set(id, canvas(id));
        grid.append(canvases.get(id));
      }
      for (const id of [...canvases.keys()]) if (!ids.includes(id)) canvases.delete(id);
    }
    const faded = root.classList.contains("px-stale") ? 0.3 : 1;
    frames = new Map(panels.map((p) => [p.id, draw(canvases.get(p.id), p, faded)]));
    for (const p of panels.filter((p) => p.points)) {
      const at = p.points.map((point) => [frames.get(p.id).X(point.at[0]), frames.get(p.id).Y(point.at[1])]);
      canvases.get(p.id).dataset.points = JSON.stringify(at);
    }
  }

  function canvas(id) {
    const made = element("canvas", "px-panel");
    made.dataset.panel = id;
    made.setAttribute("role", "img");
    made.setAttribute("aria-label", id);
    if (id === "z2") draggable(made);
    return made;
  }

  // The constraint points are dragged with the pointer (or moved by their sliders).
  function draggable(made) {
    const near = (event) => {
      const f = frames.get("z2"), panel = panels.find((p) => p.id === "z2");
      if (!f || !panel) return null;
      const far = (p) => Math.hypot(f.X(p.at[0]) - event.offsetX, f.Y(p.at[1]) - event.offsetY);
      return (panel.points || []).find((p) => p.names && far(p) < 14) || null;
    };
    made.onpointerdown = (event) => {
      dragged = near(event);
      if (!dragged) return;
      dragged.frame = frames.get("z2");
      made.setPointerCapture(event.pointerId);
      event.preventDefault();
    };
    made.onpointermove = (event) => {
      if (!dragged) {
        made.style.cursor = near(event) ? "grab" : "";
        return;
      }
      const f = dragged.frame, span = f.x[1] - f.x[0];
      const t = Math.min(Math.max(f.dataX(event.offsetX), f.x[0] + 0.01 * span), f.x[1] - 0.01 * span);
      set(dragged.names[0], t);
      set(dragged.names[1], f.dataY(event.offsetY));
    };
    made.onpointerup = made.onpointercancel = () => (dragged = null);
  }

  function buttons() {
    const row = element("div", "px-buttons");
    for (const [name, kind] of [["Python code", "code"], ["Problem file", "file"], ["Reset", "reset"]]) {
      const button = element("button", "", name);
      button.type = "button";
      button.dataset.button = kind;
      button.onclick = () => {
        if (kind === "reset") return whenFree(() => ask("reset"));
        texts.dataset.wanted = kind;
        whenFree(() => ask("texts"));
      };
      row.append(button);
    }
    return row;
  }

  function whenFree(act) {
    if (busy || waiting.size) setTimeout(() => whenFree(act), 20);
    else {
      clearTimeout(resting);
      act();
    }
  }

  function showTexts(reply) {
    stale = false;
    const open = texts.querySelector("textarea");
    if (open) {
      open.value = reply[texts.dataset.wanted];
      open.rows = Math.min(18, open.value.split("\n").length);
      return;
    }
    const area = element("textarea");
    area.readOnly = true;
    area.value = reply[texts.dataset.wanted];
    area.rows = Math.min(18, area.value.split("\n").length);
    const copy = element("button", "", "Copy");
    copy.type = "button";
    copy.onclick = () => {
      area.select();
      if (navigator.clipboard) navigator.clipboard.writeText(area.value);
      else document.execCommand("copy");
      copy.textContent = "Copied";
    };
    texts.replaceChildren(copy, area);
  }

  const listen = (reply) => answered(reply);
  model.on("msg:custom", listen);
  const watch = new ResizeObserver(() => panels.length && redraw());
  watch.observe(grid);
  root.dataset.open = 1;
  ask("picture");
  return () => {
    clearTimeout(resting);
    watch.disconnect();
    model.off("msg:custom", listen);
  };
}

export default { render };
