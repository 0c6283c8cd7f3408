"""A template's features with numbers: `rim(0.5)`, `button[3]`, and objects by name, as frames."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from affordance_templates.expressions import ExpressionError
from affordance_templates.numbers import Names, Numbers
from affordance_templates.placement import Array, placed, rotation_of, shortest_turn
from affordance_templates.reference import Reference, refer
from affordance_templates.template import Feature
from affordance_templates.template_schema import FeatureFile
from affordance_templates.tree import Posed


class Features:
    """Features of one template, parameters having values. `frame` raises ValueError about the reference that it is given, and
    config.ConfigError (one as well) about the file.
    """

    def __init__(self, numbers: Numbers, names: Names, files: Mapping[str, FeatureFile]):
        self._numbers, self._names, self._files = numbers, names, files
        self._rows = {
            name: dict(numbers.repeated(f"features.{name}", file.repeat, names)) for name, file in files.items()
        }

    def described(self, posed: Posed) -> dict[str, Feature]:
        """All of them; each is looked at once, so that what is wrong is found."""
        found = {}
        for name, file in self._files.items():
            field = f"features.{name}"
            arguments = {
                argument: (
                    self._numbers.number(f"{field}.arguments.{argument}.default", each.default, self._names),
                    self._numbers.number(f"{field}.arguments.{argument}.min", each.min, self._names),
                    self._numbers.number(f"{field}.arguments.{argument}.max", each.max, self._names),
                )
                for argument, each in file.arguments.items()
            }
            if file.arguments and file.repeat:
                raise self._numbers.document.error(
                    f"{field}.repeat", "there are arguments as well; expected one of both"
                )
            rows = list(self._rows[name])
            counts = tuple(k + 1 for k in rows[-1])
            found[name] = Feature(name, file.kind, file.on, arguments, counts)
            for row in rows:
                self._frame(Reference(name, "[" if row else "", tuple(map(float, row))), posed)
        return found

    def frame(self, text: str, posed: Posed, names: Names | None = None) -> Array:
        """(4, 4) in the template's frame. `names`: that the reference's own expressions may have; None: parameters."""
        try:
            reference = refer(text, self._names if names is None else names)
        except ExpressionError as problem:
            raise ValueError(str(problem)) from problem
        if reference.name in self._files:
            return self._frame(reference, posed)
        if reference.brackets != "(" and reference.text in posed.object_names:
            return posed.frame(reference.text)
        known = [*map(self._spelt, self._files), *posed.object_names]
        raise ValueError(
            f"got {text!r}; expected one of {', '.join(known) or 'none: there are neither features nor objects'}"
        )

    def _spelt(self, name: str) -> str:
        file = self._files[name]
        if file.repeat:
            return f"{name}[{', '.join(file.repeat)}]"
        return f"{name}({', '.join(file.arguments)})" if file.arguments else name

    def _frame(self, reference: Reference, posed: Posed) -> Array:
        known = posed.features
        if reference not in known:
            known[reference] = self._found(reference, posed)
        return known[reference]

    def _found(self, reference: Reference, posed: Posed) -> Array:
        name = reference.name
        file, field, numbers = self._files[name], f"features.{name}", self._numbers
        names = self._with_values(reference, file)
        position = numbers.vector(f"{field}.position", file.position, names)
        base = np.eye(4)
        if file.on:
            base = posed.frame(posed.object_name(f"{field}.on", file.on, names))
        return base @ placed(position, self._rotation(field, file, names))

    def _with_values(self, reference: Reference, file: FeatureFile) -> Names:
        """The names with what the reference's brackets or parentheses say."""
        spelt = self._spelt(reference.name)
        if file.repeat:
            row = tuple(map(int, reference.values))
            if reference.brackets != "[" or row not in self._rows[reference.name]:
                last = [str(k) for k in list(self._rows[reference.name])[-1]]
                raise ValueError(f"got {reference.text}; expected {spelt}, from 0 to {', '.join(last)}")
            return self._rows[reference.name][row]
        if reference.brackets == "[" or len(reference.values) > len(file.arguments):
            raise ValueError(f"got {reference.text} with {len(reference.values)} in brackets; expected {spelt}")
        names = dict(self._names)
        for k, (argument, each) in enumerate(file.arguments.items()):
            field = f"features.{reference.name}.arguments.{argument}"
            low = self._numbers.number(f"{field}.min", each.min, self._names)
            high = self._numbers.number(f"{field}.max", each.max, self._names)
            default = self._numbers.number(f"{field}.default", each.default, self._names)
            value = reference.values[k] if k < len(reference.values) else default
            if not low <= value <= high:
                raise ValueError(f"{argument} of {reference.name}: got {value:g}; expected {low:g} to {high:g}")
            names[argument] = value
        return names

    def _rotation(self, field: str, file: FeatureFile, names: Names) -> Array:
        numbers, document = self._numbers, self._numbers.document
        if (file.kind == "axis") != (file.axis is not None):
            wanted = "the direction of the axis" if file.kind == "axis" else f"none: it is a {file.kind}"
            raise document.error(f"{field}.axis", f"expected {wanted}")
        if file.axis is not None:
            return shortest_turn((1.0, 0.0, 0.0), numbers.direction(f"{field}.axis", file.axis, names))
        if file.pointing is not None:
            if file.rpy is not None:
                raise document.error(f"{field}.rpy", "there is pointing as well; expected one of both")
            return numbers.pointing(field, "pointing", file.pointing, file.across, names)
        if file.across is not None:
            raise document.error(f"{field}.across", "there is no pointing; expected both or neither")
        return np.eye(3) if file.rpy is None else rotation_of(numbers.vector(f"{field}.rpy", file.rpy, names))
