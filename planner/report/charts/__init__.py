"""Charts in a browser, drawn by the page and the explorer alike from `planner.report.panels`.

In this order: `scripts` (joins them), `scale.js`, `chart.js`, `over_time.js`, `plane.js`,
`charts.css`.
"""
