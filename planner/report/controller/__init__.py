"""The tracker in C: `controller` adds the data of one plan and machine to the C files here."""
