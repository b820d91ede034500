"""The independent check of a plan, by samples and by proofs over whole intervals.

Read the files in this order: `verify` (checks every requirement), `verdict` (combines the checks
with the proofs, also of a plan that is loaded), `summary`; then the certificate: `certify`,
`evidence`, `place_proofs`, `input_models`, `enclosure`, `functions`, `balls`, `models`.
"""
