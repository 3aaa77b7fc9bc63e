"""Values of OpenSCENARIO parameters, and expressions `${...}` of them."""

import ast
import math
import operator
import re
from collections.abc import Callable, Mapping
from typing import Any

MAX_EXPRESSION_LENGTH = 1000
NAME = r"[A-Za-z_][A-Za-z0-9_]*"
_BINARY: Mapping[type[ast.AST], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Mod: math.fmod,
}
_UNARY: Mapping[type[ast.AST], Callable[[Any], Any]] = {
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
    ast.Not: operator.not_,
}
_COMPARISONS: Mapping[type[ast.AST], Callable[[Any, Any], bool]] = {
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
}


def _sign(value: float) -> float:
    return math.copysign(1.0, value) if value else 0.0


_FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    "round": round,
    "floor": math.floor,
    "ceil": math.ceil,
    "sqrt": math.sqrt,
    "pow": math.pow,
    "sin": math.sin,
    "cos": math.cos,
    "tan": math.tan,
    "abs": abs,
    "min": min,
    "max": max,
    "sign": _sign,
}


def substitute(text: str, parameters: Mapping[str, str]) -> str:
    """Replace `$name` and `${expression}` in the value of an attribute.

    Args:
        text: The value.
        parameters: Values of the parameters by name.

    Raises:
        ValueError: A parameter has no value, or the expression is not one of the standard's.
    """
    if text.startswith("${") and text.endswith("}"):
        return _format(_evaluate(text[2:-1], parameters))
    if text.startswith("$"):
        return _look_up(text[1:], parameters)
    return text


def _look_up(name: str, parameters: Mapping[str, str]) -> str:
    if name not in parameters:
        raise ValueError(f"'${name[:40]}' has no value")
    return parameters[name]


def _evaluate(text: str, parameters: Mapping[str, str]) -> Any:
    if len(text) > MAX_EXPRESSION_LENGTH:
        raise ValueError(f"an expression has more than {MAX_EXPRESSION_LENGTH} characters")
    plain = re.sub(rf"\$({NAME})", r"parameter_\1", text.strip())
    try:
        return _evaluate_node(ast.parse(plain, mode="eval").body, parameters)
    except (SyntaxError, ArithmeticError, TypeError, RecursionError, MemoryError):
        raise ValueError(f"'{text[:40]}' cannot be evaluated") from None


def _evaluate_node(node: ast.AST, parameters: Mapping[str, str]) -> Any:
    def evaluate(inner: ast.AST) -> Any:
        return _evaluate_node(inner, parameters)

    match node:
        case ast.Constant(value=bool() | str() as value):
            return value
        case ast.Constant(value=int() | float() as value):
            return float(value)
        case ast.Name(id=name) if name.startswith("parameter_"):
            return _parse(_look_up(name.removeprefix("parameter_"), parameters))
        case ast.Name(id="true" | "false" as name):
            return name == "true"
        case ast.Name(id="pi"):
            return math.pi
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _BINARY:
            return _BINARY[type(op)](evaluate(left), evaluate(right))
        case ast.UnaryOp(op=op, operand=operand) if type(op) in _UNARY:
            return _UNARY[type(op)](evaluate(operand))
        case ast.Compare(left=left, ops=[op], comparators=[right]) if type(op) in _COMPARISONS:
            return _COMPARISONS[type(op)](evaluate(left), evaluate(right))
        case ast.BoolOp(op=op, values=values):
            found = [bool(evaluate(value)) for value in values]
            return all(found) if isinstance(op, ast.And) else any(found)
        case ast.Call(func=ast.Name(id=name), args=args, keywords=[]) if name in _FUNCTIONS:
            return _FUNCTIONS[name](*(evaluate(arg) for arg in args))
        case _:
            raise ValueError("an expression has a part unknown to the standard")


def _parse(text: str) -> Any:
    if text in ("true", "false"):
        return text == "true"
    try:
        return float(text)
    except ValueError:
        return text


def _format(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
