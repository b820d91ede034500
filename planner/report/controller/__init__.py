"""A plan's tracker in C: `controller` fills the files beside it with one plan on one machine."""
