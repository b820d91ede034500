"""The independent judge, and proofs over whole intervals.

In this order: `verify` (is every requirement kept?), `summary`, `load_plan`; then the certificate:
`certify`, `places_proven`, `input_models`, `enclosure`, `functions`, `balls`, `models`.
"""
