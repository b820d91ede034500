// Builds the page from its data.

(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const kinds = { time: TimeChart, share: ShareChart, points: PointsChart, plane: PlaneChart };
  const all = [];
  const live = document.getElementById("live");
  const FIRST = 3; // plans, of those that matter most, shown before the reader asks for more
  const known = (data.opening ?? []).filter((label) => data.plans.some((plan) => plan.label === label));
  const first = known.slice(0, FIRST);
  const page = {
    ...data,
    shown: data.plans.map((plan) => first.includes(plan.label)),
    ghost: true,
    say: (text) => (live.textContent = text),
    setCursor: (t) => all.forEach((chart) => chart.setCursor(t)),
    setTime: (t) => player.stages && (player.stop(), player.set(t)),
    showMachines: (on) => {
      page.ghost = on;
      draw();
    },
  };

  const legend = document.querySelector(".legend");
  data.plans.forEach((plan, k) => {
    const label = make("label", {}, legend);
    const box = make("input", { type: "checkbox" }, label);
    box.checked = page.shown[k];
    box.addEventListener("change", () => {
      page.shown[k] = box.checked;
      all.forEach((chart) => chart.render());
    });
    make("span", { class: `swatch plan-${plan.colour} ${styleOf(plan)}` }, label);
    make("span", { text: plan.label + (plan.refused ? " (refused)" : "") }, label);
  });
  document.getElementById("followed").hidden = !data.plans.some((plan) => plan.followed);
  legend.hidden = data.plans.length < 2 && !data.plans.some((plan) => plan.refused);

  for (const { id, panels } of data.figures) {
    const figure = document.getElementById(`fig-${id}`);
    figure.hidden = false;
    const host = figure.querySelector(".panels");
    if (panels.length === 1) host.classList.add("one");
    for (const panel of panels) {
      const place = make("div", { class: "panel" }, host);
      if (panel.band && data.plans.length > 1)
        panel.title += ` of ${data.plans[panel.series[0].plan].label}`;
      all.push(new kinds[panel.kind](place, panel, page));
    }
  }

  if (!data.figures.length) {
    document.getElementById("figures").hidden = true;
    document.querySelector(".skip").hidden = true;
  }

  const player = new Player(document.getElementById("motion"), page);

  function draw() {
    all.forEach((chart) => chart.render());
    player.render?.();
  }

  let width = 0;
  new ResizeObserver(() => {
    if (document.body.clientWidth === width) return;
    width = document.body.clientWidth;
    draw();
  }).observe(document.body);

  arrange(document.querySelector(".scroll"));

  /** Sort a table by a click on a head; show its first rows, and the others on request. */
  function arrange(place) {
    const rows = [...place.querySelectorAll("tbody tr")];
    const heads = [...place.querySelectorAll("thead th")];
    const more = make("button", { type: "button", class: "more", text: `All ${rows.length} plans` });
    const showAll = () => {
      rows.forEach((row) => (row.hidden = false));
      more.remove();
    };
    if (rows.length > FIRST) {
      const label = (row) => row.querySelector("[data-label]")?.dataset.label;
      const kept = rows.filter((row) => first.includes(label(row)));
      if (kept.length) {
        rows.forEach((row) => (row.hidden = !kept.includes(row)));
        more.addEventListener("click", showAll);
        place.after(more);
      }
    }
    heads.forEach((head, k) => {
      const button = make("button", { type: "button", class: "sort", title: "Sort by this column" });
      button.append(...head.childNodes);
      head.append(button);
      button.addEventListener("click", () => {
        const way = head.ariaSort === "ascending" ? -1 : 1;
        heads.forEach((other) => (other.ariaSort = null));
        head.ariaSort = way > 0 ? "ascending" : "descending";
        const text = (row) => row.children[k].textContent.replace("\u2212", "-").trim();
        const size = (row) => (k ? parseFloat(text(row)) : NaN);
        const order = (a, b) => {
          const [x, y] = [size(a), size(b)];
          const last = Number.isNaN(x) - Number.isNaN(y); // rows without a number
          return last || way * (Number.isNaN(x) ? text(a).localeCompare(text(b)) : x - y);
        };
        showAll();
        rows[0].parentNode.append(...[...rows].sort(order));
      });
    });
  }

  const copy = document.getElementById("copy");
  if (navigator.clipboard) {
    copy.hidden = false;
    copy.addEventListener("click", async () => {
      try {
        await navigator.clipboard.writeText(document.getElementById("command").textContent);
        copy.textContent = "Copied";
      } catch {
        copy.textContent = "Not allowed";
      }
      setTimeout(() => (copy.textContent = "Copy"), 2000);
    });
  }
})();
