"""The independent judge, and proofs over whole intervals.

In this order: `verify` (is every requirement kept?), `summary`, `load_plan`; then
the certificate: `certify`, `requirements_proven`, `cells`, `enclosure`, `input_models`,
`functions`, `balls`, `affine_models`.
"""
