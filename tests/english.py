"""Find code that reads the program's own English: labels, reasons, advice, headlines, titles.

English is output. Who needs more than the text reads a field. A value counts as prose if its name
says so, if it is a text of two words or more, or if it is assigned from or returned by such a
value. Reading is `in`, ==, a slice, a regular expression, or a method such as `startswith`; to
join, escape or print is not.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Mapping, Set

PROSE = {
    "label", "reason", "sentence", "body", "advice", "why", "otherwise", "blamed", "finding",
    "objective_name", "headline", "remark", "verdict", "title", "hindrance", "reservations",
    "heading", "message", "ways", "list_head",
}  # fmt: skip
LOOSE = PROSE | {"text", "part", "line", "says"}
"""Names of any text, also of files: to look for a word in one counts, for a mark does not."""
READERS = {
    "startswith", "endswith", "removeprefix", "removesuffix", "partition", "rpartition", "split",
    "rsplit", "splitlines", "find", "rfind", "index", "rindex", "count", "replace",
}  # fmt: skip
PATTERNS = {"match", "search", "fullmatch", "findall", "finditer", "sub", "subn", "split"}
ALIKE = {"strip", "lstrip", "rstrip", "lower", "capitalize", "join", "format", "escape"}
FOREIGN = {
    "OSError", "ImportError", "ModuleNotFoundError", "UnicodeDecodeError", "JSONDecodeError",
    "TOMLDecodeError", "KeyError", "SyntaxError", "TypeError", "ValidationError", "AttributeError",
    "BadZipFile", "RecursionError", "RuntimeError",
}  # fmt: skip
"""Exceptions of other programs: what they say may be read."""


def readings(trees: Mapping[str, ast.Module]) -> Iterator[tuple[str, str]]:
    """Yield (file:function, source) of each place that reads prose."""
    prose = _prose_functions(trees)
    for name, tree in trees.items():
        for scope in ast.walk(tree):
            if isinstance(scope, ast.FunctionDef | ast.ClassDef | ast.Module):
                flow, loose = _Flow(scope, prose), _Flow(scope, prose, LOOSE)
                where = f"{name}:{getattr(scope, 'name', '')}"
                for node in flow.nodes:
                    if flow.reads(node) or (_seeks_word(node) and loose.reads(node)):
                        yield where, ast.unparse(node)


def _prose_functions(trees: Mapping[str, ast.Module]) -> set[str]:
    """Return the names of functions that return prose, found to a fixed point."""
    every = [n for tree in trees.values() for n in ast.walk(tree) if isinstance(n, ast.FunctionDef)]
    texts = [f for f in every if f.returns and ast.unparse(f.returns) in ("str", "str | None")]
    named = [f.name for f in every]
    texts = [f for f in texts if named.count(f.name) <= 2]
    prose: set[str] = set()
    while new := {f.name for f in texts if f.name not in prose and _Flow(f, prose).returns_prose()}:
        prose |= new
    return prose


def _own_nodes(scope: ast.AST) -> Iterator[ast.AST]:
    """Yield the nodes of a function, class or module without those of functions inside it."""
    todo = list(ast.iter_child_nodes(scope))
    while todo:
        node = todo.pop()
        yield node
        if not isinstance(node, ast.FunctionDef | ast.ClassDef):
            todo += ast.iter_child_nodes(node)


class _Flow:
    """Which names of one function are prose."""

    def __init__(self, scope: ast.AST, functions: set[str], prose: Set[str] = PROSE) -> None:
        self.nodes, self.functions, self.prose = list(_own_nodes(scope)), functions, prose
        self.names = {n.arg for n in self.nodes if isinstance(n, ast.arg) and n.arg in self.prose}
        self.errors = {
            n.name
            for n in self.nodes
            if isinstance(n, ast.ExceptHandler) and n.name and n.type
            if not FOREIGN & {getattr(x, "id", getattr(x, "attr", "")) for x in ast.walk(n.type)}
        }
        size = -1
        while len(self.names) > size:
            size = len(self.names)
            for node in self.nodes:
                self.names |= self.assigned(node)

    def assigned(self, node: ast.AST) -> set[str]:
        pairs: list[tuple[ast.expr, ast.expr | None]] = []
        if isinstance(node, ast.Assign):
            pairs = [(target, node.value) for target in node.targets]
        elif isinstance(node, ast.AnnAssign | ast.NamedExpr | ast.AugAssign):
            pairs = [(node.target, node.value)]
        elif isinstance(node, ast.For | ast.comprehension):
            items = node.iter.elts if isinstance(node.iter, ast.Tuple | ast.List) else []
            pairs = [(node.target, item) for item in items if not isinstance(item, ast.Constant)]
            parts = node.target.elts if isinstance(node.target, ast.Tuple) else [node.target]
            return {n.id for n in parts if isinstance(n, ast.Name) and n.id in self.prose} | {
                t.id for t, v in pairs if isinstance(t, ast.Name) and self.is_prose(v)
            }
        out = set()
        for target, value in pairs:
            if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
                both = zip(target.elts, value.elts, strict=False)
            elif isinstance(target, ast.Tuple):
                out |= {t.id for t in target.elts if isinstance(t, ast.Name) and t.id in self.prose}
                continue
            else:
                both = zip([target], [value], strict=True)
            out |= {t.id for t, v in both if isinstance(t, ast.Name) and self.is_prose(v)}
        return out

    def is_prose(self, node: ast.expr | None) -> bool:
        out = False
        match node:
            case ast.Name(id=name):
                out = name in self.names
            case ast.Attribute(attr=name):
                out = name in self.prose
            case ast.Subscript(value=value, slice=key):
                out = self.is_prose(value) or getattr(key, "value", "") in self.prose
            case ast.Constant(value=str(text)):
                out = _is_sentence(text)
            case ast.JoinedStr(values=parts):
                text = " ".join(str(p.value) for p in parts if isinstance(p, ast.Constant))
                fields = [p.value for p in parts if isinstance(p, ast.FormattedValue)]
                out = _is_sentence(text) or any(map(self.is_prose, fields))
            case ast.Call(func=function, args=given):
                out = self.gives_prose(function, given)
            case ast.BinOp() | ast.IfExp() | ast.BoolOp() | ast.NamedExpr():
                out = any(map(self.is_prose, _operands(node)))
        return out

    def gives_prose(self, function: ast.expr, given: list[ast.expr]) -> bool:
        """Whether a call returns prose."""
        match function:
            case ast.Name(id="str"):
                names = {a.id for a in given if isinstance(a, ast.Name)}
                return bool(names & (self.errors | self.names))
            case ast.Name(id=name):
                return name in self.functions
            case ast.Attribute(attr=name, value=value):
                alike = name in ALIKE | READERS and self.is_prose(value)
                escaped = name in ("escape", "sub") and any(map(self.is_prose, given))
                named = (
                    bool(given) and name == "get" and getattr(given[0], "value", "") in self.prose
                )
                return alike or escaped or named or name in self.functions
        return False

    def returns_prose(self) -> bool:
        return any(isinstance(n, ast.Return) and self.is_prose(n.value) for n in self.nodes)

    def reads(self, node: ast.AST) -> bool:
        """Whether a node reads the content of prose; to compare it with "" is no reading."""
        out = False
        match node:
            case ast.Compare(left=left, ops=[ast.In() | ast.NotIn()], comparators=[right]):
                many = isinstance(right, ast.Tuple | ast.List | ast.Set)
                out = self.is_prose(right) and not many and not self.is_prose(left)
            case ast.Compare(left=left, ops=[ast.Eq() | ast.NotEq()], comparators=[right]):
                texts = [s for s in (left, right) if isinstance(s, ast.Constant) and s.value]
                others = [s for s in (left, right) if not isinstance(s, ast.Constant)]
                out = bool(texts) and any(map(self.is_prose, others))
            case ast.Call(func=ast.Attribute(value=ast.Name(id="re"), attr=name), args=given):
                texts = [a for a in given if not isinstance(a, ast.Constant | ast.JoinedStr)]
                out = name in PATTERNS and any(map(self.is_prose, texts))
            case ast.Call(func=ast.Attribute(value=value, attr=name)):
                own = isinstance(value, ast.Constant | ast.JoinedStr)
                out = name in READERS and not own and self.is_prose(value)
            case ast.Call(func=ast.Name(id="float" | "int"), args=[only]):
                out = self.is_prose(only)
            case ast.Subscript(value=value, slice=ast.Slice(), ctx=ast.Load()):
                out = self.is_prose(value) and not isinstance(value, ast.Attribute)
        return out


def _operands(node: ast.BinOp | ast.IfExp | ast.BoolOp | ast.NamedExpr) -> list[ast.expr]:
    if isinstance(node, ast.BinOp):
        return [node.left, node.right] if isinstance(node.op, ast.Add) else []
    if isinstance(node, ast.IfExp):
        return [node.body, node.orelse]
    return node.values if isinstance(node, ast.BoolOp) else [node.value]


def _seeks_word(node: ast.AST) -> bool:
    """Whether a comparison or a call of a method looks for a given word."""
    sought: list[ast.expr] = []
    if isinstance(node, ast.Compare):
        sought = [node.left, *node.comparators]
    elif isinstance(node, ast.Call):
        sought = node.args
    texts = (s.value for s in sought if isinstance(s, ast.Constant) and isinstance(s.value, str))
    return any(re.search("[A-Za-z]{3}", text) for text in texts)


def _is_sentence(text: str) -> bool:
    return sum(word.isalpha() and len(word) > 1 for word in text.split()) >= 2
