"""Expressions as the statements of a C function, each written once, before its first use."""

from collections.abc import Collection, Iterable, Mapping, Sequence

from cruise.export.c_arrays import Arrays, Filled, Product
from cruise.export.c_expressions import ATOM, LONGEST, NAMES, Node, Text, written

WRITTEN_OUT = 16  # places of the longest array that is filled without a loop
Targets = Mapping[str, Collection[Node]]  # arrays that are assigned to, and what to their places


def statements(arrays: Arrays, targets: Targets, comments: Mapping[int, str] | None = None) -> list[str]:
    """Lines of a function that fills every target, in order; comments by the number of a place."""
    writer = _Writer(arrays, targets)
    for name, nodes in targets.items():
        writer.fill(name, list(nodes), comments or {})
    return writer.lines


class _Writer:
    def __init__(self, arrays: Arrays, targets: Targets) -> None:
        self.arrays, self.lines = arrays, list[str]()
        self.named: dict[Node, Text] = {}
        self.filled: dict[str, str] = {}  # arrays that are there, by name, and what C calls them
        self.uses: dict[Node, int] = {}
        self._count(node for nodes in targets.values() for node in nodes)

    def fill(self, name: str, nodes: list[Node], comments: Mapping[int, str]) -> None:
        source = _whole_array(nodes)
        if len(nodes) > WRITTEN_OUT and source in self.arrays.arrays:
            loop = f"for (int i = 0; i < {len(nodes)}; ++i)"
            self.lines.append(f"{loop} {name}[i] = {self._array(source)}[i];")
            return
        for place, node in enumerate(nodes):
            text = self._text(node)
            if place in comments:
                self.lines.append(f"/* {comments[place]} */")
            self.lines.append(f"{name}[{place}] = {text.text};")

    def _count(self, nodes: Iterable[Node]) -> None:
        """How often each is read, by what the targets need."""
        waiting, seen = list(nodes), set[str]()
        for node in waiting:
            self.uses[node] = self.uses.get(node, 0) + 1
        while waiting:
            node = waiting.pop()
            inputs = list(node.inputs)
            for name in self._sources(node):
                if name not in seen:
                    seen.add(name)
                    inputs += self._read(name)
            for one in inputs:
                self.uses[one] = self.uses.get(one, 0) + 1
                if self.uses[one] == 1:
                    waiting.append(one)

    def _sources(self, node: Node) -> list[str]:
        name = node.text.split("[")[0]
        return [name] if name in self.arrays.arrays else []

    def _read(self, name: str) -> list[Node]:
        """Expressions that an array is made of."""
        array = self.arrays.arrays[name]
        return list((array if isinstance(array, Filled) else array.vector).nodes)

    def _text(self, node: Node, inner: list[str] | None = None, local: dict[Node, Text] | None = None) -> Text:
        """The text of an expression, after what it needs; what holds the index is written inside its loop."""
        waiting = [node]
        while waiting:
            one = waiting[-1]
            known = local if one.index and local is not None else self.named
            missing = [each for each in one.inputs if each not in self.named and each not in (local or {})]
            if one in known:
                waiting.pop()
            elif missing:
                waiting += reversed(missing)
            else:
                waiting.pop()
                lines = inner if one.index and inner is not None else self.lines
                known[one] = self._written(
                    one, [(local or {}).get(each) or self.named[each] for each in one.inputs], lines
                )
        return (local or {}).get(node) or self.named[node]

    def _written(self, node: Node, inputs: list[Text], lines: list[str]) -> Text:
        text = written(node, inputs, self.arrays.prefix)
        for name in self._sources(node):
            text = text._replace(text=text.text.replace(name, self._array(name), 1))
        cheap = node.operator in ("leaf", "constant") or (node.operator == "at" and self.uses.get(node, 1) == 1)
        if cheap or (self.uses.get(node, 1) == 1 and len(text.text) <= LONGEST):
            return text
        name = f"t{len(self.named)}" if not node.index else f"u{len(lines)}"
        lines.append(f"const {NAMES[node.kind]} {name} = {text.text};")
        return Text(name, ATOM)

    def _array(self, name: str) -> str:
        """What C calls an array, once it is filled."""
        if name in self.filled:
            return self.filled[name]
        array = self.arrays.arrays[name]
        if isinstance(array, Product):
            self._product(array)
        else:
            self._fill(array)
        return self.filled[name]

    def _product(self, product: Product) -> None:
        vector, (rows, columns) = self._array(product.vector.name), product.shape
        self.filled[product.name] = product.name
        self.lines.append(f"float {product.name}[{rows}];")
        sizes = f"{rows}, {columns}"
        self.lines.append(f"{self.arrays.prefix}_product({product.weight}, {sizes}, {vector}, {product.name});")

    def _fill(self, array: Filled) -> None:
        known = _whole_array(array.nodes)
        if known and len(array.nodes) in (array.size, array.nodes[0].index):
            self.filled[array.name] = known  # it is there already
            return
        if len(array.nodes) == 1 and array.size > 1:
            inner: list[str] = []
            text = self._text(array.nodes[0], inner, {})
            body = [*inner, f"{array.name}[i] = {text.text};"]
            head = f"for (int i = 0; i < {array.size}; ++i)"
            loop = [f"{head} {body[0]}"] if len(body) == 1 else [f"{head} {{", *(f"    {line}" for line in body), "}"]
            self.lines += [f"float {array.name}[{array.size}];", *loop]
        else:
            texts = [self._text(node).text for node in array.nodes]
            self.lines.append(f"const float {array.name}[{array.size}] = {{{', '.join(texts)}}};")
        self.filled[array.name] = array.name


def _whole_array(nodes: Sequence[Node]) -> str:
    """The array of C whose places these are, all in order or with the open index; none: nothing."""
    name = nodes[0].text.split("[")[0]
    places = ["@"] if nodes[0].index else range(len(nodes))
    return name if [node.text for node in nodes] == [f"{name}[{place}]" for place in places] else ""
