"""The most floating-point operations of a control step in exported C, beside those of an episode.

    python benchmarks/operations.py [--policies NAME …]

The bound comes from the program's text: the dearer branch of every condition, and every loop to its
end. The episode's are counted by operations.cc, the same program in C++ with numbers that count. It
needs ``cc``, ``c++`` and PyPI's ``pycparser``; docs/development/exported-c.md has the table.
"""

import operator
import subprocess
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import deploy
import numpy as np
import tyro
from pycparser import CParser, c_ast as c

from pter_gym.benchmark import find_policy
from pter_gym.benchmark.episodes import find_episodes
from pter_gym.policies import shipped_policies
from pter_gym.policies.find import DETECTOR
from pter_gym.policies.tuned import tuned_policies
from pter_gym.tools.deploy import source_of

HERE = Path(__file__).parent
NETWORKS = (*shipped_policies(), f"universal{DETECTOR}")
STEP = ("pter_encoder", "pter_encoder", "pter_observe", "pter_act")
"""What a control step calls."""

SUMS = {"+": operator.add, "-": operator.sub, "*": operator.mul, "%": np.fmod}
COUNTED = {"+", "-", "*", "/", "<", ">", "<=", ">=", "==", "!="}
INTEGER, REAL = (c.IdentifierType([name]) for name in ("int", "double"))


class Operations(NamedTuple):
    """Sums, products, quotients and comparisons of floating-point numbers; quotients alone."""

    all: int = 0
    quotients: int = 0

    def __add__(self, other: Any) -> "Operations":
        return Operations(self.all + other.all, self.quotients + other.quotients)

    def __mul__(self, times: Any) -> "Operations":
        return Operations(self.all * times, self.quotients * times)


NONE = Operations()


class Value(NamedTuple):
    """An expression: its operations, its type, and its number if that is a known integer."""

    cost: Operations = NONE
    kind: Any = INTEGER
    number: int | None = None


def dearer(*branches: Operations) -> Operations:
    """Return what no branch exceeds."""
    return Operations(*map(max, zip(*branches, strict=True)))


def total(values: Any) -> Operations:
    return sum((each.cost for each in values), NONE)


def assigned_in(node: Any) -> set[str]:
    """Return the names of variables that statements change."""
    inner = set().union(*(assigned_in(child) for _, child in node.children()))
    match node:
        case c.Assignment(lvalue=c.ID(name=name)):
            return inner | {name}
    return inner


class Program:
    """What a C program's functions take at most, on a path of so many arcs."""

    def __init__(self, text: str, path_arcs: int) -> None:
        self.path_arcs = path_arcs
        parsed = CParser().parse(text).ext
        self.functions = {each.decl.name: each for each in parsed if isinstance(each, c.FuncDef)}
        self.types = {each.name: each.type for each in parsed if isinstance(each, c.Typedef)}
        variables = [each for each in parsed if isinstance(each, c.Decl)]
        self.variables = {each.name: Value(kind=each.type) for each in variables}
        self.bound = cache(self._bound)

    def _bound(self, function: str, *numbers: int | None) -> Operations:
        """Return the most operations of a call with these integers, None where one is unknown."""
        called = self.functions[function]
        parameters = called.decl.type.args.params
        numbers = numbers or (None,) * len(parameters)
        scope = Scope(self, assigned_in(called.body))
        for each, number in zip(parameters, numbers, strict=True):
            scope.declare(each, number)
        return scope.cost(called.body)

    def kind(self, node: Any) -> Any:
        """Return what a type is in the end: a struct, an array, a pointer or an elementary one."""
        while True:
            match node:
                case c.IdentifierType(names=[name]) if name in self.types:
                    node = self.types[name]
                case c.TypeDecl() | c.Typename():
                    node = node.type
                case _:
                    return node

    def is_real(self, value: Value) -> bool:
        kind = self.kind(value.kind)
        return isinstance(kind, c.IdentifierType) and kind.names[0] in ("float", "double")


class Scope:
    """The names of a function, and the numbers of those integers that nothing changes."""

    def __init__(self, program: Program, changed: set[str]) -> None:
        self.program = program
        self.changed = changed
        self.names = dict(program.variables)

    def declare(self, what: Any, number: int | None) -> None:
        known = None if what.name in self.changed else number
        self.names[what.name] = Value(kind=what.type, number=known)

    def cost(self, node: Any) -> Operations:
        """Return the most operations of a statement."""
        match node:
            case c.Compound(block_items=parts) | c.DeclList(decls=parts):
                return self.sequence(parts or [])
            case c.Decl():
                begin = self.value(node.init)
                self.declare(node, begin.number)
                return begin.cost
            case c.If():
                return self.cost(node.cond) + dearer(
                    self.cost(node.iftrue), self.cost(node.iffalse)
                )
            case c.For():
                turns = self.turns(node)
                return self.cost(node.init) + self.cost(node.stmt) * turns
            case c.Return():
                return self.cost(node.expr)
            case c.Break() | c.EmptyStatement() | c.Pragma():
                return NONE
        return self.value(node).cost

    def sequence(self, parts: list[Any]) -> Operations:
        """Return the most operations of statements, some of which may return early."""
        cost = NONE
        for at, part in enumerate(parts):
            match part:
                case c.If(iftrue=c.Compound(block_items=[*_, c.Return()]), iffalse=None):
                    rest = self.sequence(parts[at + 1 :])
                    return cost + self.cost(part.cond) + dearer(self.cost(part.iftrue), rest)
            cost += self.cost(part)
        return cost

    def turns(self, loop: Any) -> int:
        """Return the turns of ``for (i = a; i < b; i += c)``, or of one with >."""
        match loop:
            case c.For(
                init=c.DeclList(decls=[c.Decl(init=first)]),
                cond=c.BinaryOp(op="<" | ">", right=last),
                next=c.UnaryOp(op="p++") | c.Assignment(op="+=") as step,
            ):
                by = 1 if isinstance(step, c.UnaryOp) else self.value(step.rvalue).number
                begin, end = self.value(first).number, self.value(last).number
                if begin is not None and end is not None:
                    return len(range(begin, end, by))
        raise ValueError(f"no bound for the loop at {loop.coord}")

    def value(self, node: Any) -> Value:
        """Return an expression's value; both sides of && and the dearer of ?: are counted."""
        match node:
            case None:
                return Value()
            case c.Constant(type="int"):
                return Value(number=int(node.value))
            case c.Constant():
                real = node.type in ("float", "double")
                return Value(kind=REAL if real else INTEGER)
            case c.ID():
                return self.names[node.name]
            case c.Cast() | c.CompoundLiteral():
                inner = self.value(getattr(node, "expr", None) or node.init)
                return Value(inner.cost, node.to_type if isinstance(node, c.Cast) else node.type)
            case c.InitList():
                return Value(total(map(self.value, node.exprs)))
            case c.UnaryOp():
                return self.unary(node)
            case c.BinaryOp():
                return self.binary(node)
        return self.compound(node)

    def compound(self, node: Any) -> Value:
        """Return the value of what has several parts."""
        match node:
            case c.StructRef():
                return self.member(node)
            case c.ArrayRef():
                of, at = self.value(node.name), self.value(node.subscript)
                return Value(of.cost + at.cost, self.program.kind(of.kind).type)
            case c.FuncCall():
                given = [self.value(each) for each in node.args.exprs]
                name = node.name.name
                called = self.program.bound(name, *(each.number for each in given))
                result = self.program.functions[name].decl.type.type
                return Value(total(given) + called, result)
            case c.TernaryOp():
                yes, no = self.value(node.iftrue), self.value(node.iffalse)
                kind = yes.kind if self.program.is_real(yes) else no.kind
                return Value(self.value(node.cond).cost + dearer(yes.cost, no.cost), kind)
            case c.Assignment():
                into, given = self.value(node.lvalue), self.value(node.rvalue)
                real = node.op != "=" and self.program.is_real(into)
                return Value(into.cost + given.cost + Operations(int(real)), into.kind)
        raise ValueError(f"{type(node).__name__} at {node.coord} is not known here")

    def member(self, node: Any) -> Value:
        of = self.value(node.name)
        kind = self.program.kind(of.kind)
        if node.type == "->":
            kind = self.program.kind(kind.type)
        (found,) = (each.type for each in kind.decls if each.name == node.field.name)
        arcs = self.program.path_arcs if node.field.name == "count" else None
        return Value(of.cost, found, arcs)

    def unary(self, node: Any) -> Value:
        of = self.value(node.expr)
        if node.op == "&":
            return Value(of.cost, c.PtrDecl([], of.kind))
        if node.op == "*":
            return Value(of.cost, self.program.kind(of.kind).type)
        literal = isinstance(node.expr, c.Constant)
        negated = -of.number if node.op == "-" and of.number is not None else None
        counted = node.op == "-" and self.program.is_real(of) and not literal
        return Value(of.cost + Operations(int(counted)), of.kind, negated)

    def binary(self, node: Any) -> Value:
        left, right = self.value(node.left), self.value(node.right)
        known, cost = None, left.cost + right.cost
        if None not in (left.number, right.number) and node.op in SUMS:
            known = int(SUMS[node.op](left.number, right.number))
        real = self.program.is_real(left) or self.program.is_real(right)
        if real and node.op in COUNTED:
            cost += Operations(1, int(node.op == "/"))
        if node.op not in ("+", "-", "*", "/", "%"):
            return Value(cost)
        return Value(cost, REAL if real else left.kind, known)


def bound(folder: Path, path_arcs: int) -> Operations:
    """Return the most operations of a control step of the program in a folder."""
    command = ("cc", "-E", "-P", "-std=c99", "-D__attribute__(x)=", "pter.c")
    text = subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True).stdout
    program = Program(text, path_arcs)
    return sum((program.bound(each) for each in STEP), NONE)


def counted(folder: Path, rows: Any) -> list[Operations]:
    """Return the operations of each control step with readings and observations."""
    command = ("c++", "-std=c++20", "-O1", "-w", "-I", folder, HERE / "operations.cc")
    subprocess.run([*command, "-o", folder / "operations"], check=True)
    run = subprocess.run(
        [folder / "operations"], input=rows.tobytes(), check=True, capture_output=True
    )
    return [Operations(*map(int, row)) for row in np.frombuffer(run.stdout, "<u4").reshape(-1, 2)]


def main(policies: tuple[str, ...] = ("impedance", *tuned_policies(), *NETWORKS)) -> None:
    """Print the table."""
    standard = find_episodes("standard", "medium").first(1)
    (machine,), (task,), (seed,) = standard.machines, standard.tasks, standard.seeds
    print("| Policy | Weights | In the episode | Bound | Divisions in it | For each further arc |")
    print("|---|---|---:|---:|---:|---:|")
    for name in policies:
        policy = find_policy(name)
        is_network = name in NETWORKS
        for weights in ("float", "int8") if is_network else ("float",):
            source = source_of(policy, name=name, weights=weights)
            with deploy.folder_of(source) as folder:
                rows = deploy.rows_of(
                    source, *deploy.recorded(source.policy, machine, task, seed)[:2]
                )
                most = dearer(*counted(folder, rows))
                one, two = (bound(folder, arcs) for arcs in (1, 2))
            print(
                f"| `{name}` | {weights if is_network else ''} | {most.all:,} | "
                f"{one.all:,} | {one.quotients:,} | {two.all - one.all:,} |",
                flush=True,
            )


if __name__ == "__main__":
    tyro.cli(main)
