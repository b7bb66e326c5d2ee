"""All small wrong changes to a module: numbers, comparisons, arithmetic, terms left out."""

import ast
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from types import CodeType
from typing import Any, NamedTuple

TOP = Path(__file__).resolve().parents[2]
PACKAGE = TOP / "sumo_mcts"

NEGATED: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt, ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip
EXCHANGED: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult, ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd,
}  # fmt: skip
# The other one of two functions; each of their arguments may also stand alone.
TWINS = {"min": "max", "max": "min"}
WITHOUT_MEANING = (ast.Raise, ast.Assert, ast.JoinedStr)  # texts, and what only guards
# Numbers that are data, not rules: those that `sumo-mcts drivers --fit` finds, and those frozen in
# the reference problem, by which it is named.
DATA = ("WEIGHTS", "_COST", "_WAITING", "VERSIONS")


class Mutant(NamedTuple):
    """One change."""

    path: str  # of the module, from the package on
    function: str  # qualified name of the function or method; "": the module itself
    first: int  # the function's first line
    line: int
    text: str  # the line, as it is
    change: str  # "before -> after"
    order: int  # among all changes of the module

    @property
    def key(self) -> str:
        """What names the change, whatever its line number is."""
        return f"{self.path}::{self.function}: {self.text}: {self.change}"


class _Place(NamedTuple):
    """Where in the syntax tree a node can be replaced, and by what."""

    owner: ast.AST
    field: str
    index: int  # in a list; -1: the field is the node
    old: ast.AST
    new: ast.AST


class _Function(NamedTuple):
    node: ast.AST
    name: str
    first: int


def mutants(path: str) -> list[Mutant]:
    """All changes to a module, in the order of its lines."""
    source = (PACKAGE / path).read_text(encoding="utf-8")
    lines, seen, found = source.splitlines(), Counter[str](), []
    for order, (function, place) in enumerate(_changes(ast.parse(source))):
        line = place.old.lineno  # type: ignore[attr-defined]
        made = Mutant(
            path, function.name, function.first, line, lines[line - 1].strip(), _shown(place), order
        )
        seen[made.key] += 1
        if seen[made.key] > 1:
            made = made._replace(change=f"{made.change} ({seen[made.key]})")
        found.append(made)
    return found


def compiled(mutant: Mutant) -> CodeType:
    """The module's code with the change."""
    tree = ast.parse((PACKAGE / mutant.path).read_text(encoding="utf-8"))
    for order, (_, place) in enumerate(_changes(tree)):
        if order == mutant.order:
            _put(place)
            break
    return compile(ast.fix_missing_locations(tree), str(PACKAGE / mutant.path), "exec")


def codes(module: CodeType) -> dict[tuple[str, int], CodeType]:
    """The code of all functions of a module by (qualified name, first line)."""
    found, left = {}, [module]
    while left:
        for each in left.pop().co_consts:
            if isinstance(each, CodeType):
                found[each.co_qualname, each.co_firstlineno] = each
                left.append(each)
    return found


def _put(place: _Place) -> None:
    ast.copy_location(place.new, place.old)
    if place.index < 0:
        setattr(place.owner, place.field, place.new)
    else:
        getattr(place.owner, place.field)[place.index] = place.new


def _shown(place: _Place) -> str:
    before, after = (" ".join(ast.unparse(each).split()) for each in (place.old, place.new))
    return f"{before} -> {after}"


def _changes(tree: ast.Module) -> Iterator[tuple[_Function, _Place]]:
    for function in _functions(tree):
        # statements, so neither the decorators nor what stands in the head
        for place in _statements(function.node):
            yield function, place


def _functions(tree: ast.AST, prefix: str = "") -> Iterator[_Function]:
    """The module, its functions, and the methods of its classes."""
    if isinstance(tree, ast.Module):
        yield _Function(tree, "", 0)
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef):
            first = min([node.lineno, *(each.lineno for each in node.decorator_list)])
            yield _Function(node, prefix + node.name, first)
        elif isinstance(node, ast.ClassDef):
            yield from _functions(node, f"{prefix}{node.name}.")


def _statements(function: Any) -> Iterator[_Place]:
    of_module = isinstance(function, ast.Module)
    for k, statement in enumerate(function.body):
        if of_module and (
            not isinstance(statement, ast.Assign | ast.AnnAssign) or _name(statement) in DATA
        ):
            continue
        yield from _below(function, "body", k, statement)


def _name(statement: ast.Assign | ast.AnnAssign) -> str:
    target = statement.targets[0] if isinstance(statement, ast.Assign) else statement.target
    return target.id if isinstance(target, ast.Name) else ""


def _below(owner: ast.AST, field: str, index: int, node: ast.AST) -> Iterator[_Place]:
    """The changes of a node and of all that it contains."""
    if isinstance(node, WITHOUT_MEANING):
        return
    for new in _instead(node):
        yield _Place(owner, field, index, node, new)
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list", "args") and not isinstance(
            node, ast.Call
        ):
            continue
        for k, each in enumerate(value if isinstance(value, list) else [value]):
            if isinstance(each, ast.AST):
                yield from _below(node, name, k if isinstance(value, list) else -1, each)


def _instead(node: ast.AST) -> Iterator[ast.AST]:
    """What a node may wrongly become."""
    match node:
        case ast.Constant(value=bool(value)):
            yield ast.Constant(not value)
        case ast.Constant(value=int(value) | float(value)):
            more = value + 1 if isinstance(value, int) else 2.0 * value
            yield ast.Constant(more or 1.0)
        case ast.Compare(left=left, ops=[op], comparators=[right]) if type(op) in NEGATED:
            yield ast.Compare(left, [NEGATED[type(op)]()], [right])
        case ast.Compare(left=left, ops=[first, second], comparators=[middle, right]):
            yield ast.Compare(left, [first], [middle])
            yield ast.Compare(middle, [second], [right])
        case ast.BinOp(left=left, op=op, right=right):
            yield from _other_arithmetic(left, op, right)
        case ast.AugAssign(target=target, op=ast.Add() | ast.Sub() as op, value=value):
            yield ast.AugAssign(target, EXCHANGED[type(op)](), value)
            yield ast.Pass()
        case ast.AugAssign() | ast.Expr(value=ast.Call()):
            yield ast.Pass()
        case ast.Assign(targets=[ast.Subscript() | ast.Attribute()]):
            yield ast.Pass()
        case ast.BoolOp(op=op, values=values):
            yield ast.BoolOp(ast.Or() if isinstance(op, ast.And) else ast.And(), values)
            for k in range(len(values)):
                rest = [*values[:k], *values[k + 1 :]]
                yield rest[0] if len(rest) == 1 else ast.BoolOp(op, rest)
        case ast.UnaryOp(op=ast.USub() | ast.Not(), operand=operand):
            yield operand
        case ast.IfExp(body=body, orelse=orelse):
            yield body
            yield orelse
        case ast.If(test=ast.Name() | ast.Attribute() | ast.Call() as test):
            yield ast.If(ast.UnaryOp(ast.Not(), test), node.body, node.orelse)
        case ast.Call(func=ast.Name(id=name), args=[_, _, *_] as args) if name in TWINS:
            yield ast.Call(ast.Name(TWINS[name], ast.Load()), args, node.keywords)
            yield from args
        case ast.Call(func=ast.Name(id="abs"), args=[each]):
            yield each
        case ast.Subscript(value=value, slice=ast.Name(id="node"), ctx=ctx):
            yield ast.Subscript(value, ast.Constant(0), ctx)


def _other_arithmetic(left: ast.expr, op: ast.operator, right: ast.expr) -> Iterator[ast.AST]:
    if type(op) in EXCHANGED:
        yield ast.BinOp(left, EXCHANGED[type(op)](), right)
    yield left
    if not isinstance(op, ast.Pow | ast.Mod | ast.FloorDiv | ast.Div) and ast.dump(
        left
    ) != ast.dump(right):
        yield right
