"""Charts in a browser, which the page and the explorer draw from `planner.report.panels`.

In this order: `scripts` (joins the files), `scale.js`, `chart.js`, `over_time.js`, `plane.js`,
`charts.css`.
"""
