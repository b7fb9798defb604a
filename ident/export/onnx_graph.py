"""ONNX graphs put together as formulas: a `Tensor` is one with arithmetic, of doubles.

The laws of joints are written with +, *, ** and what their `xp` has: given tensors in the place of
arrays they write their own nodes. Cosines are sines a quarter turn on: runtimes have none of
doubles.

Source: ONNX operators, opset 17.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ident.arrays import Array

# Of the operators, and of the file's format, which runtimes of the same age read.
VERSIONS = {"opset": 17, "ir_version": 9}


class Graph:
    """Nodes and constants of a graph while it grows; it is what laws take for `xp`."""

    def __init__(self) -> None:
        from onnx import helper, numpy_helper

        self._helper = helper
        self._numpy = numpy_helper
        self.nodes: list[object] = []
        self.names: dict[bytes, str] = {}
        self.constants: list[object] = []
        self.inputs: list[object] = []
        self.outputs: list[object] = []

    def input(self, name: str, shape: Sequence[int | str]) -> Tensor:
        """A tensor of doubles that is given to the graph."""
        kind = self._helper.np_dtype_to_tensor_dtype(np.dtype(float))
        self.inputs.append(self._helper.make_tensor_value_info(name, kind, list(shape)))
        return Tensor(self, name)

    def output(self, name: str, term: Tensor, shape: Sequence[int | str]) -> None:
        """A tensor of doubles that the graph gives."""
        kind = self._helper.np_dtype_to_tensor_dtype(np.dtype(float))
        self.nodes.append(self._helper.make_node("Identity", [term.name], [name]))
        self.outputs.append(self._helper.make_tensor_value_info(name, kind, list(shape)))

    def constant(self, values: Array | float | Sequence[float]) -> Tensor:
        """A tensor of doubles, or of integers where `values` are; the same ones stand once."""
        array = np.asarray(values)
        if array.dtype != np.int64:
            array = array.astype(float)
        key = repr((array.dtype, array.shape)).encode() + array.tobytes()
        if key not in self.names:
            name = f"constant_{len(self.constants)}"
            self.names[key] = name
            self.constants.append(self._numpy.from_array(np.ascontiguousarray(array), name))
        return Tensor(self, self.names[key])

    def node(self, kind: str, *terms: Tensor, **attributes: int | list[int]) -> Tensor:
        """The first output of an operator."""
        name = f"term_{len(self.nodes)}"
        names = [term.name for term in terms]
        self.nodes.append(self._helper.make_node(kind, names, [name], **attributes))
        return Tensor(self, name)

    def exp(self, term: Tensor) -> Tensor:
        """Exponential of each element."""
        return self.node("Exp", term)

    def sin(self, term: Tensor) -> Tensor:
        """Sine of each element."""
        return self.node("Sin", term)

    def cos(self, term: Tensor) -> Tensor:
        """Cosine of each element."""
        return self.node("Sin", term + 0.5 * np.pi)

    def tanh(self, term: Tensor) -> Tensor:
        """Hyperbolic tangent of each element."""
        return self.node("Tanh", term)

    def clip(self, term: Tensor, low: Array | float, high: Array | float) -> Tensor:
        """Values within bounds, which may be of each column."""
        return self.node("Min", self.node("Max", term, self.constant(low)), self.constant(high))

    def concat(self, terms: Sequence[Tensor]) -> Tensor:
        """Columns of several (N, k) tensors side by side."""
        return self.node("Concat", *terms, axis=1)

    def reshape(self, term: Tensor, *shape: int) -> Tensor:
        """A tensor's elements in another shape; -1 stands for what is left over."""
        return self.node("Reshape", term, self.constant(np.array(shape, dtype=np.int64)))

    def finish(self, name: str, about: str) -> bytes:
        """The graph as the file of an ONNX model, checked.

        Args:
            name: Of the graph.
            about: What a reader is told of it.
        """
        from onnx import checker

        ends = (self.inputs, self.outputs)
        graph = self._helper.make_graph(self.nodes, name, *ends, self.constants)
        imports = [self._helper.make_opsetid("", VERSIONS["opset"])]
        versions = {"opset_imports": imports, "ir_version": VERSIONS["ir_version"]}
        model = self._helper.make_model(graph, **versions)
        model.doc_string = about
        model.producer_name = "armgap"
        checker.check_model(model, full_check=True)
        return bytes(model.SerializeToString())


@dataclass(frozen=True, eq=False)
class Tensor:
    """A tensor of a graph."""

    graph: Graph
    name: str

    def _with(self, kind: str, other: Tensor | Array | float, turned: bool = False) -> Tensor:
        term = other if isinstance(other, Tensor) else self.graph.constant(other)
        return self.graph.node(kind, term, self) if turned else self.graph.node(kind, self, term)

    # NumPy is not to take a term for one of an array's numbers.
    __array_ufunc__ = None

    def __add__(self, other: Tensor | Array | float) -> Tensor:
        return self._with("Add", other)

    def __radd__(self, other: Array | float) -> Tensor:
        return self._with("Add", other, turned=True)

    def __sub__(self, other: Tensor | Array | float) -> Tensor:
        return self._with("Sub", other)

    def __rsub__(self, other: Array | float) -> Tensor:
        return self._with("Sub", other, turned=True)

    def __mul__(self, other: Tensor | Array | float) -> Tensor:
        return self._with("Mul", other)

    def __rmul__(self, other: Array | float) -> Tensor:
        return self._with("Mul", other, turned=True)

    def __truediv__(self, other: Tensor | Array | float) -> Tensor:
        return self._with("Div", other)

    def __pow__(self, other: float) -> Tensor:
        return self._with("Pow", other)

    def __matmul__(self, other: Tensor | Array) -> Tensor:
        return self._with("MatMul", other)

    def __neg__(self) -> Tensor:
        return self.graph.node("Neg", self)

    def __abs__(self) -> Tensor:
        return self.graph.node("Abs", self)

    def columns(self, *numbers: int) -> Tensor:
        """Some columns of an (N, k) tensor."""
        places = self.graph.constant(np.array(numbers, dtype=np.int64))
        return self.graph.node("Gather", self, places, axis=1)
