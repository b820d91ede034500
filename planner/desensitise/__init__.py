"""What desensitised planning adds to collocation.

In reading order: `spread` (the design errors), `seeds` (first guesses), `refusal` (what is refused
before the search). Motion and response as one system is `planner.ocp.augmented`, which collocation
transcribes, solves and refines like any other. The method that uses them is
`planner.methods.desensitised`.
"""
