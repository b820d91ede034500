"""Files that are written from tables are as the tables are now."""

from __future__ import annotations

import types
import typing
from typing import Any, Literal

import generated


def test_files_are_what_is_written_from_their_tables() -> None:
    stale = [
        path.name for path, text in generated.files().items() if path.read_text("utf-8") != text
    ]
    assert stale == [], "run: make generated"


def test_editors_know_the_keywords_of_every_method() -> None:
    stub: dict[str, Any] = {"__name__": "stub"}
    exec(compile(generated.stub(), "options.pyi", "exec", dont_inherit=True), stub)
    keys = {method.name: set(method.options.model_fields) for method in generated.OWN}
    common = {"warm", "time_limit_s", "progress"}
    for name, own in keys.items():
        typed = stub["".join(word.title() for word in name.split("_"))]
        assert typed.__optional_keys__ == own | common
        assert not typed.__required_keys__
    found = typing.get_type_hints(stub["Polynomial"])
    assert found["points"] == list[list[float]] | Literal["auto"]
    assert found["criterion"] == Literal["peak", "margin"]
    assert found["allow_singular"] is bool
    assert typing.get_type_hints(stub["Desensitised"])["effort_limit"] == float | None
    call: Any = types.SimpleNamespace(__module__="stub", __qualname__="Solve.__call__")
    first, *_, last = forms = typing.get_overloads(call)
    assert len(forms) == len(keys) + 1
    assert typing.get_type_hints(first)["method"] == Literal["collocation"]  # where none is named
    assert typing.get_type_hints(last)["method"] is str
