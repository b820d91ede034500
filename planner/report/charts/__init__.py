"""Charts in a browser, drawn by the page and the explorer alike, and what they are fed.

In this order: `panels` (the numbers), `scale.js`, `chart.js`, `over_time.js`, `charts.css`.
"""
