"""What every method returns, and what can be read of it.

In this order: `trajectory`, `retimed`, `fastest_timing`, `quadrature`, `measures`, `claims`,
`plan`, `samples`.
"""
