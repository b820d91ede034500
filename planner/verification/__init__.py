"""The independent judge, and proofs over whole intervals.

In this order: `verify` (is every requirement kept?), `verdict` (with what is proven), `summary`,
`load_plan`; then the certificate: `certify`, `evidence`, `place_proofs`, `input_models`,
`enclosure`, `functions`, `balls`, `models`.
"""
