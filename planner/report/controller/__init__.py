"""The tracker of one plan in C: `controller` fills the source files beside it for one machine."""
