// Builds the page from its data.

(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const kinds = { time: TimeChart, share: ShareChart, points: PointsChart, plane: PlaneChart };
  const all = [];
  const live = document.getElementById("live");
  const page = {
    ...data,
    shown: data.plans.map(() => true),
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
    box.checked = true;
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
