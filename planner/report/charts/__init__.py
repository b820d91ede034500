"""Scripts with which the page and the explorer draw `planner.report.panels` in a browser.

`scripts` joins the files. Read them in this order: `scale.js` (scales and numbers), `chart.js`
(parts common to all charts), `over_time.js`, `plane.js` (the two kinds of panel), `charts.css`.
"""
