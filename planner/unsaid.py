"""Lines of solvers that tell a user nothing, kept from standard output and standard error."""

from __future__ import annotations

import contextlib
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Literal, TextIO, cast


@contextmanager
def unsaid(words: str, stream: Literal["stdout", "stderr"]) -> Iterator[None]:
    """Keep lines with these words from a stream of the main thread, to which it belongs."""
    target = getattr(sys, stream)
    if threading.current_thread() is not threading.main_thread() or target is None:
        yield
        return
    redirect = contextlib.redirect_stdout if stream == "stdout" else contextlib.redirect_stderr
    sieve = _Sieve(target, words)
    with redirect(cast(TextIO, sieve)):
        try:
            yield
        finally:
            sieve.end()


class _Sieve:
    """A stream that passes on line by line, and some lines not at all."""

    def __init__(self, stream: TextIO, words: str) -> None:
        self._stream, self._words, self._begun = stream, words, ""

    def write(self, text: str) -> int:
        *lines, self._begun = (self._begun + text).split("\n")
        for line in lines:
            if self._words not in line:
                self._stream.write(f"{line}\n")
        return len(text)

    def end(self) -> None:
        """Pass on a line that has not ended."""
        if self._begun:
            self._stream.write(self._begun)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)
