"""Runs URScript programs, as far as they compute, read and write registers, and move joints.

A program is translated to Python generators: each `yield` is the end of a time slice. What a
program may contain is a closed list, so that a text from the network reaches nothing else. Motions
and registers are functions that the robot hands in.
"""

from __future__ import annotations

import ast
import keyword
import re
from collections.abc import Callable, Generator

ITERATIONS_MAX = 10_000
"""Iterations of loops without a time slice between them, after which a program is ended."""
BYTES_MAX = 1 << 20
"""Longest program [bytes]."""

_OPENS = re.compile(r"(def|sec|thread|while|if)\b.*:$")
_GOES_ON = re.compile(r"(elif\b.*|else\s*):$")
_GLOBAL = re.compile(r"\bglobal\s+(\w+)\s*=")
_VALUE_BELOW = re.compile(r"=[ \t]*(?:#.*)?\n[ \t]*([-\w.]+)[ \t]*(?=global\b|\n)")
_KEYWORDS = {"and", "break", "continue", "def", "elif", "else", "if", "not", "or"}
_KEYWORDS |= {"global", "pass", "return", "while", "True", "False"}
_TAKEN = re.compile(r'("[^"]*")|\b(' + "|".join(sorted(set(keyword.kwlist) - _KEYWORDS)) + r")\b")
"""Texts, and names that are keywords of Python only."""
_NODES = (
    ast.Module, ast.FunctionDef, ast.arguments, ast.arg, ast.Return, ast.Assign, ast.While, ast.If,
    ast.Expr, ast.Pass, ast.Break, ast.Continue, ast.BoolOp, ast.BinOp, ast.UnaryOp, ast.Compare,
    ast.Call, ast.keyword, ast.Constant, ast.Name, ast.List, ast.Tuple, ast.Subscript, ast.Load,
    ast.Store, ast.boolop, ast.Add, ast.Sub, ast.Mult, ast.Div, ast.Mod, ast.unaryop, ast.cmpop,
)  # fmt: skip


class ScriptError(Exception):
    """What is wrong with a program."""


def complete(text: str) -> tuple[list[str], str]:
    """Whole programs at the beginning of a text, and what is left of it."""
    programs, lines, depth, taken = [], [], 0, 0
    for line in text.splitlines(keepends=True):
        if not line.endswith("\n"):
            break
        bare = _bare(line)
        depth += bool(_OPENS.match(bare)) - (bare == "end")
        lines.append(line)
        if depth <= 0:
            program = "".join(lines)
            if program.strip():
                programs.append(program)
            taken += len(program)
            lines, depth = [], 0
    return programs, text[taken:]


def _bare(line: str) -> str:
    """A line without its comment; a `#` in a text is left alone."""
    return re.sub(r'("[^"]*")|#.*', lambda match: match.group(1) or "", line).strip()


def _python(text: str) -> tuple[str, set[str], str | None]:
    """The same as Python's text, the names of its globals, and that of the program."""
    # URScript has no ends of statements: a value may stand on the line below its `=`.
    text = _VALUE_BELOW.sub(r"= \1\n", text)
    lines, depth, main = [], 0, None
    for line in map(_bare, text.splitlines()):
        if not line or line == "run program":
            continue
        if line == "end":
            depth -= 1
            continue
        opens, goes_on = _OPENS.match(line), _GOES_ON.match(line)
        if opens and depth == 0:
            main = re.sub(r"\W.*", "", line.split(None, 1)[1])
        line = _TAKEN.sub(lambda match: match.group(1) or f"{match.group(2)}_", line)
        line = re.sub(r"^(thread|sec)\b", "def", line)
        line = re.sub(r"^local\s+", "", _GLOBAL.sub(r"\1 =", line))
        line = re.sub(r"\brun\s+(\w+)\s*\(", r"run_thread(\1, ", line)
        line = re.sub(r"^(?:kill|join)\s+(\w+)$", r"kill_thread(\1)", line)
        lines.append("    " * (depth - bool(goes_on)) + line)
        if opens or goes_on:
            depth += bool(opens)
            lines.append("    " * depth + "pass")
    return "\n".join(lines) + "\n", set(_GLOBAL.findall(text)), main


class _Generators(ast.NodeTransformer):
    """Makes every function a generator, and every call of one wait for it."""

    def __init__(self, globals_: set[str], waits: set[str]) -> None:
        self.globals_, self.waits = globals_, waits

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        self.generic_visit(node)
        names = self.globals_ - {argument.arg for argument in node.args.args}
        head = ast.parse("if False:\n    yield").body
        if names:
            head.insert(0, ast.Global(sorted(names)))
        node.body = head + node.body
        return node

    def visit_While(self, node: ast.While) -> ast.AST:
        self.generic_visit(node)
        node.body = ast.parse("count_iteration()").body + node.body
        return node

    def visit_Subscript(self, node: ast.Subscript) -> ast.AST:
        self.generic_visit(node)
        # `p[x, y, z, rx, ry, rz]` is a pose.
        index = node.slice
        if isinstance(index, ast.Tuple) and getattr(node.value, "id", "") == "p":
            return ast.List(index.elts, ast.Load())
        return node

    def visit_Call(self, node: ast.Call) -> ast.AST:
        self.generic_visit(node)
        if not isinstance(node.func, ast.Name):
            raise ScriptError("only functions can be called")
        return ast.YieldFrom(node) if node.func.id in self.waits else node


class Program:
    """A program that runs, a time slice at a time.

    `functions` are what it may call, those in `waiting` are generators, which may last.
    """

    def __init__(
        self, text: str, functions: dict[str, Callable], waiting: dict[str, Callable]
    ) -> None:
        python, globals_, main = _python(text)
        try:
            tree = ast.parse(python)
        except (SyntaxError, ValueError, RecursionError) as error:
            raise ScriptError(f"is no URScript that this server can read: {error}") from error
        for node in ast.walk(tree):
            name = getattr(node, "id", getattr(node, "name", ""))
            if not isinstance(node, _NODES) or str(name).startswith("__"):
                line = getattr(node, "lineno", 0)
                raise ScriptError(f"line {line}: {type(node).__name__} is not known here")
        own = {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}
        if main is None:
            # A line by itself is run as a program of that line.
            python = "def line():\n" + "".join(f"    {line}\n" for line in python.splitlines())
            tree, main = ast.parse(python), "line"
        tree = _Generators(globals_, own | set(waiting)).visit(tree)
        self.name = main
        self._threads: dict[int, Generator] = {}
        self._next = 1
        self._iterations = 0
        names = {
            "__builtins__": {},
            "enter_critical": None,
            "exit_critical": None,
            "run_thread": self._run,
            "kill_thread": self._kill,
            "count_iteration": self._count,
            **functions,
            **waiting,
        }
        exec(compile(ast.fix_missing_locations(tree), main, "exec"), names)
        self._run(names[main])

    @property
    def running(self) -> bool:
        """Whether its first thread has not ended."""
        return 1 in self._threads

    def slice(self) -> None:
        """Runs every thread to the end of its time slice; raises `ScriptError`."""
        for number in list(self._threads):
            thread = self._threads.get(number)
            if thread is None:
                continue
            self._iterations = 0
            try:
                next(thread)
            except StopIteration:
                self._threads.pop(number, None)
            except ScriptError:
                raise
            except Exception as error:
                raise ScriptError(f"program `{self.name}`: {error}") from error

    def _run(self, function: Callable[..., Generator], *arguments: object) -> int:
        number = self._next
        self._threads[number] = function(*arguments)
        self._next += 1
        return number

    def _kill(self, number: int) -> None:
        self._threads.pop(number, None)

    def _count(self) -> None:
        self._iterations += 1
        if self._iterations > ITERATIONS_MAX:
            raise ScriptError("a loop without a time slice: expected sync() or a motion in it")
