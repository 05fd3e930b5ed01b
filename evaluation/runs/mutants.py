# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Mutants of a Python file: one small change of an operator, comparison, factor, branch or argument each.

Texts of errors and log messages, annotations, decorators, assertions and f-strings are not changed, nor are
conditions of which only a log message depends, and functions that only compile kernels.
"""

from __future__ import annotations

import ast
import copy
from collections import Counter
from dataclasses import dataclass, replace

_BOUNDARY = {ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt}
_NEGATION = {
    ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip
_ARITHMETIC = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult, ast.Pow: ast.Mult, ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd,
}  # fmt: skip
#: Keyword arguments whose default gives the same result for correct code.
_NEUTRAL_ARGUMENTS = {"dtype", "strict", "encoding", "copy", "description", "title", "examples", "stacklevel"}
_LOGGERS = {"log", "logger", "_log", "_logger", "logging", "warnings", "sys"}
#: Integers up to this one are counts and indices, which are incremented; larger ones are doubled.
_LARGEST_COUNT = 10


@dataclass(frozen=True, slots=True)
class Mutant:
    """A change of one expression or statement.

    Attributes
    ----------
    path : str
        File relative to the root of the tree.
    function : str
        Qualified name of the enclosing function, empty at module level and in class bodies.
    start, end : int
        Changed bytes of the file.
    number : int
        Number of the mutant among those of the function with the same texts, from 1.
    """

    path: str
    line: int
    function: str
    operator: str
    before: str
    after: str
    start: int
    end: int
    number: int = 1

    @property
    def key(self) -> str:
        """Return an identification that does not depend on line numbers."""
        return f"{self.path}::{self.function} {self.operator} #{self.number}: {self.before} -> {self.after}"

    def applied(self, source: bytes) -> bytes:
        """Return the changed source of the file; the lines after the change keep their numbers.

        Raises
        ------
        SyntaxError
            If the change is not valid at its place, such as a name instead of a statement.
        """
        line_ends = "\n" * source[self.start : self.end].count(b"\n")
        new = f"pass{line_ends}" if self.after == "pass" else f"({self.after}{line_ends})"
        changed = source[: self.start] + new.encode() + source[self.end :]
        ast.parse(changed)
        return changed


def mutants(path: str, source: bytes) -> list[Mutant]:
    """Return all mutants of a file, in the order of the file."""
    finder = _Finder(path, source)
    finder.visit(ast.parse(source))
    keys: Counter[str] = Counter()
    numbered = []
    for mutant in sorted(finder.mutants, key=lambda m: (m.start, m.end, m.operator, m.after)):
        keys[mutant.key] += 1
        numbered.append(replace(mutant, number=keys[mutant.key]))
    return numbered


class _Finder(ast.NodeVisitor):
    def __init__(self, path: str, source: bytes) -> None:
        self.path, self.mutants = path, list[Mutant]()
        self._scope: list[str] = []
        self._functions = 0
        self._line_starts = [0]
        for line in source.splitlines(keepends=True):
            self._line_starts.append(self._line_starts[-1] + len(line))

    def _add(self, operator: str, node: ast.expr | ast.stmt, new: ast.AST | str) -> None:
        after = new if isinstance(new, str) else ast.unparse(new)
        start = self._line_starts[node.lineno - 1] + node.col_offset
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        end = self._line_starts[node.end_lineno - 1] + node.end_col_offset
        function = ".".join(self._scope) if self._functions else ""
        self.mutants.append(
            Mutant(self.path, node.lineno, function, operator, ast.unparse(node), after, start, end)
        )

    # -- scopes

    def visit_FunctionDef(self, node: ast.FunctionDef | ast.AsyncFunctionDef) -> None:
        if node.name == "__repr__" or _only_compiles(node):
            return
        for default in (*node.args.defaults, *node.args.kw_defaults):
            if default is not None:
                self.visit(default)
        self._scope.append(node.name)
        self._functions += 1
        for statement in node.body:
            self.visit(statement)
        self._functions -= 1
        self._scope.pop()

    visit_AsyncFunctionDef = visit_FunctionDef

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        self._scope.append(node.name)
        for statement in node.body:
            self.visit(statement)
        self._scope.pop()

    # -- not changed

    def _skip(self, node: ast.AST) -> None:
        """Leave texts, assertions and type patterns as they are."""

    visit_Raise = visit_Assert = visit_JoinedStr = visit_Import = visit_ImportFrom = visit_match_case = _skip

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self.visit(node.value)

    # -- operators

    def visit_Compare(self, node: ast.Compare) -> None:
        for index, operation in enumerate(node.ops):
            for name, table in (("boundary", _BOUNDARY), ("negated comparison", _NEGATION)):
                if type(operation) in table:
                    new = copy.deepcopy(node)
                    new.ops[index] = table[type(operation)]()
                    self._add(name, node, new)
        self.generic_visit(node)

    def visit_BinOp(self, node: ast.BinOp) -> None:
        if not _has_text(node):
            if isinstance(node.op, ast.MatMult):
                self._add("matrix product", node, ast.BinOp(node.right, node.op, node.left))
            elif type(node.op) in _ARITHMETIC:
                self._add("arithmetic", node, ast.BinOp(node.left, _ARITHMETIC[type(node.op)](), node.right))
        self.generic_visit(node)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        if isinstance(node.op, ast.USub | ast.Not):
            self._add("sign" if isinstance(node.op, ast.USub) else "negation", node, node.operand)
        self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        swapped = ast.Or() if isinstance(node.op, ast.And) else ast.And()
        self._add("and/or", node, ast.BoolOp(swapped, node.values))
        for index in range(len(node.values)):
            other_operands = [value for other, value in enumerate(node.values) if other != index]
            self._add(
                "dropped operand",
                node,
                other_operands[0] if len(other_operands) == 1 else ast.BoolOp(node.op, other_operands),
            )
        self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> None:
        value = node.value
        if isinstance(value, bool):
            self._add("constant", node, str(not value))
        elif isinstance(value, int):
            self._add("constant", node, str(value + 1 if value <= _LARGEST_COUNT else 2 * value))
        elif isinstance(value, float):
            self._add("constant", node, repr(value + 1.0 if value < 1.0 else 2.0 * value))

    # -- branches, statements and arguments

    def visit_If(self, node: ast.If | ast.While | ast.IfExp) -> None:
        if isinstance(node, ast.If) and not node.orelse and all(map(_is_log_statement, node.body)):
            return
        if not isinstance(node.test, ast.Constant) and ast.unparse(node.test) != "TYPE_CHECKING":
            self._add("dropped branch", node.test, "False")
            if not isinstance(node, ast.While):
                self._add("dropped branch", node.test, "True")
        self.generic_visit(node)

    visit_While = visit_IfExp = visit_If

    def visit_Expr(self, node: ast.Expr) -> None:
        if isinstance(node.value, ast.Constant) or _is_log(node.value):
            return
        if isinstance(node.value, ast.Call):
            self._add("dropped statement", node, "pass")
        self.generic_visit(node)

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        self._add("dropped statement", node, "pass")
        self.generic_visit(node)

    def visit_Continue(self, node: ast.Continue) -> None:
        self._add("dropped statement", node, "pass")

    def visit_Call(self, node: ast.Call) -> None:
        for keyword in node.keywords:
            if keyword.arg is not None and keyword.arg not in _NEUTRAL_ARGUMENTS:
                other_keywords = [other for other in node.keywords if other is not keyword]
                self._add("dropped argument", node, ast.Call(node.func, node.args, other_keywords))
        self.visit(node.func)
        for argument in node.args:
            self.visit(argument)
        for keyword in node.keywords:
            if keyword.arg not in _NEUTRAL_ARGUMENTS:
                self.visit(keyword.value)


def _has_text(node: ast.BinOp) -> bool:
    return any(
        isinstance(side, ast.JoinedStr) or (isinstance(side, ast.Constant) and isinstance(side.value, str))
        for side in (node.left, node.right)
    )


def _only_compiles(node: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    """Return whether a function calls kernels only so that their first real call is not delayed.

    It returns nothing, and its docstring states the purpose: "Compile the kernels."
    """
    returns_nothing = isinstance(node.returns, ast.Constant) and node.returns.value is None
    return returns_nothing and (ast.get_docstring(node) or "").startswith("Compile ")


def _is_log_statement(node: ast.stmt) -> bool:
    return isinstance(node, ast.Expr) and _is_log(node.value)


def _is_log(node: ast.expr) -> bool:
    return isinstance(node, ast.Call) and ast.unparse(node.func).split(".")[0].strip("_") in {
        name.strip("_") for name in _LOGGERS
    }
