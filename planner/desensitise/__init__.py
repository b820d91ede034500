"""What desensitised planning is made of.

In reading order: `spread` (the design errors), `augmented` (motion and response as one system),
`program` (its transcription), `task` (one problem's numbers, and a solve), `seeds`, `settle` (mesh
and limits after the solve). The method that uses them is `planner.methods.desensitised`.
"""
