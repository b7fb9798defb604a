"""ONNX graphs put together as formulas: a `Term` is a tensor with arithmetic, in double precision.

The laws of joints are written with +, *, ** and what their `xp` has: given terms in the place of arrays
they write their own nodes. Cosines are sines a quarter turn on: runtimes have no cosine of doubles.

Source: ONNX operators, opset 17.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ident.arrays import Array

OPSET = 17
# Of the file's format, which runtimes of the same age read.
FORMAT_VERSION = 9


class Graph:
    """Nodes and constants of a graph while it grows; it is what laws take for `xp`."""

    def __init__(self) -> None:
        from onnx import helper, numpy_helper

        self._helper = helper
        self._numpy = numpy_helper
        self.nodes: list[Any] = []
        self.constants: dict[bytes, Any] = {}
        self.inputs: list[Any] = []
        self.outputs: list[Any] = []

    def input(self, name: str, shape: Sequence[int | str]) -> Term:
        """A tensor of doubles that is given to the graph."""
        kind = self._helper.np_dtype_to_tensor_dtype(np.dtype(float))
        self.inputs.append(self._helper.make_tensor_value_info(name, kind, list(shape)))
        return Term(self, name)

    def output(self, name: str, term: Term, shape: Sequence[int | str]) -> None:
        """A tensor of doubles that the graph gives."""
        kind = self._helper.np_dtype_to_tensor_dtype(np.dtype(float))
        self.nodes.append(self._helper.make_node("Identity", [term.name], [name]))
        self.outputs.append(self._helper.make_tensor_value_info(name, kind, list(shape)))

    def constant(self, values: Array | float | Sequence[float]) -> Term:
        """A tensor of doubles, or of integers where `values` are such an array; the same ones stand once."""
        array = np.asarray(values)
        if array.dtype != np.int64:
            array = array.astype(float)
        key = repr((array.dtype, array.shape)).encode() + array.tobytes()
        if key not in self.constants:
            name = f"constant_{len(self.constants)}"
            self.constants[key] = self._numpy.from_array(np.ascontiguousarray(array), name)
        return Term(self, self.constants[key].name)

    def node(self, kind: str, *terms: Term, **attributes: Any) -> Term:
        """The first output of an operator."""
        name = f"term_{len(self.nodes)}"
        names = [term.name for term in terms]
        self.nodes.append(self._helper.make_node(kind, names, [name], **attributes))
        return Term(self, name)

    def exp(self, term: Term) -> Term:
        return self.node("Exp", term)

    def sin(self, term: Term) -> Term:
        return self.node("Sin", term)

    def cos(self, term: Term) -> Term:
        return self.node("Sin", term + 0.5 * np.pi)

    def tanh(self, term: Term) -> Term:
        return self.node("Tanh", term)

    def clip(self, term: Term, low: Array | float, high: Array | float) -> Term:
        """Values within bounds, which may be of each column."""
        return self.node("Min", self.node("Max", term, self.constant(low)), self.constant(high))

    def concat(self, terms: Sequence[Term]) -> Term:
        """Columns of several (N, k) tensors side by side."""
        return self.node("Concat", *terms, axis=1)

    def reshape(self, term: Term, *shape: int) -> Term:
        return self.node("Reshape", term, self.constant(np.array(shape, dtype=np.int64)))

    def model(self, name: str, about: str) -> Any:
        """The finished graph as an ONNX model, checked.

        Args:
            name: Of the graph.
            about: What a reader is told of it.
        """
        from onnx import checker

        constants = list(self.constants.values())
        graph = self._helper.make_graph(self.nodes, name, self.inputs, self.outputs, constants)
        imports = [self._helper.make_opsetid("", OPSET)]
        model = self._helper.make_model(graph, opset_imports=imports, ir_version=FORMAT_VERSION)
        model.doc_string = about
        model.producer_name = "armgap"
        checker.check_model(model, full_check=True)
        return model


@dataclass(frozen=True, eq=False)
class Term:
    """A tensor of a graph."""

    graph: Graph
    name: str

    def _with(self, kind: str, other: Term | Array | float, turned: bool = False) -> Term:
        term = other if isinstance(other, Term) else self.graph.constant(other)
        return self.graph.node(kind, term, self) if turned else self.graph.node(kind, self, term)

    # NumPy is not to take a term for one of an array's numbers.
    __array_ufunc__ = None

    def __add__(self, other: Term | Array | float) -> Term:
        return self._with("Add", other)

    def __radd__(self, other: Array | float) -> Term:
        return self._with("Add", other, turned=True)

    def __sub__(self, other: Term | Array | float) -> Term:
        return self._with("Sub", other)

    def __rsub__(self, other: Array | float) -> Term:
        return self._with("Sub", other, turned=True)

    def __mul__(self, other: Term | Array | float) -> Term:
        return self._with("Mul", other)

    def __rmul__(self, other: Array | float) -> Term:
        return self._with("Mul", other, turned=True)

    def __truediv__(self, other: Term | Array | float) -> Term:
        return self._with("Div", other)

    def __pow__(self, other: float) -> Term:
        return self._with("Pow", other)

    def __matmul__(self, other: Term | Array) -> Term:
        return self._with("MatMul", other)

    def __neg__(self) -> Term:
        return self.graph.node("Neg", self)

    def __abs__(self) -> Term:
        return self.graph.node("Abs", self)

    def columns(self, *numbers: int) -> Term:
        """Some columns of an (N, k) tensor."""
        places = self.graph.constant(np.array(numbers, dtype=np.int64))
        return self.graph.node("Gather", self, places, axis=1)
