# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The part of AADL 2.1 (SAE AS5506B) of the views of TASTE: text to packages and back.

Names, keywords and values of properties are kept as they are written; two views are equal in meaning if their
packages are equal, since AADL ignores case, white space and comments. Comments with ``--!`` are
kept: ``asn2aadl`` states the MD5 sums of the ASN.1 files in them.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass

from cdff_common.errors import InputError

#: Largest text of a view, characters; the largest published one has 0.2 million.
MAX_CHARACTERS = 16_000_000

_TOKEN = re.compile(
    r"""(?P<space>\s+|--[^\n]*)
    |(?P<text>"(?:[^"\n]|"")*")
    |(?P<number>[0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]+)?)
    |(?P<name>[A-Za-z_][A-Za-z0-9_]*)
    |(?P<sign>\+=>|=>|->|<->|::|\.\.|[-:;{}(),.+\[\]*])""",
    re.VERBOSE,
)
_CATEGORIES = ("subprogram", "system", "data", "process", "processor", "thread", "device", "bus", "memory")
_CATEGORIES_OF_TWO = (("virtual", "processor"), ("virtual", "bus"), ("thread", "group"))
_SECTIONS = ("features", "subcomponents", "connections", "properties")
#: Signs that are written without a space before or after them.
_TIGHT = ("::", ".")


@dataclass(frozen=True, slots=True)
class Token:
    """A word of the text and its line; two tokens are equal if AADL reads them as the same."""

    text: str
    line: int

    @property
    def meaning(self) -> str:
        """The text by which AADL compares: in lower case, unless it is in quotes."""
        return self.text if self.text.startswith('"') else self.text.lower()


def _meaning(text: str) -> tuple[str, ...]:
    """Return the words of a text as AADL compares them."""
    return tuple(token.meaning for token in _tokens(text, "a view"))


class _ByMeaning(ABC):
    """Base of what AADL compares without case: equal if ``meaning`` is."""

    __slots__ = ()

    @property
    @abstractmethod
    def meaning(self) -> object:
        """Content by which AADL compares."""

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _ByMeaning) and type(self) is type(other) and self.meaning == other.meaning

    def __hash__(self) -> int:
        return hash(self.meaning)


@dataclass(frozen=True, slots=True, eq=False)
class Property(_ByMeaning):
    """Property of a package, a component or one of its items: ``name => value``.

    Attributes
    ----------
    name : str
        With the property set, e.g. ``Taste::RCMperiod``.
    value : str
        As it is written, e.g. ``1000 ms`` or ``"2.0"``.
    """

    name: str
    value: str

    @property
    def meaning(self) -> object:
        """Content by which AADL compares."""
        return self.name.lower(), _meaning(self.value)

    @property
    def text(self) -> str:
        """Value without quotes if it is a single text."""
        words = list(_tokens(self.value, self.name))
        if len(words) == 1 and self.value.startswith('"'):
            return self.value[1:-1].replace('""', '"')
        return self.value


@dataclass(frozen=True, slots=True, eq=False)
class Item(_ByMeaning):
    """Feature, subcomponent or connection: ``name : content {properties};``."""

    name: str
    content: str
    properties: tuple[Property, ...] = ()

    @property
    def meaning(self) -> object:
        """Content by which AADL compares."""
        return self.name.lower(), _meaning(self.content), frozenset(self.properties)


@dataclass(frozen=True, slots=True, eq=False)
class Component(_ByMeaning):
    """Type or implementation of a component.

    Attributes
    ----------
    category : str
        In lower case, e.g. ``subprogram``.
    name : str
        Of an implementation with its suffix, e.g. ``PI_run.others``.
    """

    category: str
    name: str
    is_implementation: bool = False
    features: tuple[Item, ...] = ()
    subcomponents: tuple[Item, ...] = ()
    connections: tuple[Item, ...] = ()
    properties: tuple[Property, ...] = ()

    @property
    def meaning(self) -> object:
        """Content by which AADL compares."""
        return (
            self.category,
            self.name.lower(),
            self.is_implementation,
            self.features,  # parameters of a subprogram have an order
            frozenset(self.subcomponents),
            frozenset(self.connections),
            frozenset(self.properties),
        )

    def value(self, name: str) -> str | None:
        """Return the value of a property of the component, None without it."""
        return value_of(self.properties, name)


@dataclass(frozen=True, slots=True, eq=False)
class Package(_ByMeaning):
    """Package with its components."""

    name: str
    imports: tuple[str, ...] = ()
    components: tuple[Component, ...] = ()
    properties: tuple[Property, ...] = ()

    @property
    def meaning(self) -> object:
        """Content by which AADL compares; components have no order."""
        imports = frozenset(name.lower() for name in self.imports)
        return self.name.lower(), imports, frozenset(self.components), frozenset(self.properties)


def value_of(properties: tuple[Property, ...], name: str) -> str | None:
    """Return the value of a property, None without it; names are compared without case."""
    found = [p.text for p in properties if p.name.lower() == name.lower()]
    return found[0] if found else None


@dataclass(frozen=True, slots=True)
class View:
    """File of AADL: packages, and the notes of its comments ``--!``."""

    packages: tuple[Package, ...]
    notes: tuple[str, ...] = ()


def parse_view(text: str, source: str) -> View:
    """Return the packages of a text; raises InputError with file and line.

    Parameters
    ----------
    source : str
        Name of the file in errors.
    """
    if len(text) > MAX_CHARACTERS:
        raise InputError(f"{source}: {len(text)} characters, expected at most {MAX_CHARACTERS}")
    notes = tuple(m[1].strip() for m in re.finditer(r"^[ \t]*--!([^\n]*)$", text, re.MULTILINE))
    parser = _Parser(list(_tokens(text, source)), source)
    packages = []
    while not parser.at_end:
        packages.append(parser.package())
    if not packages:
        raise InputError(f"{source}: no package; expected an interface or data view of TASTE (AADL)")
    return View(tuple(packages), notes)


def _tokens(text: str, source: str) -> Iterator[Token]:
    position, line = 0, 1
    while position < len(text):
        match = _TOKEN.match(text, position)
        if match is None:
            found = text[position : position + 20].split("\n")[0]
            raise InputError(f"{source}:{line}: found {found!r}, expected a word of AADL")
        if match.lastgroup != "space":
            yield Token(match[0], line)
        line += match[0].count("\n")
        position = match.end()


class _Parser:
    """Parser of the tokens of a file."""

    def __init__(self, tokens: list[Token], source: str) -> None:
        self._tokens, self._source, self._next = tokens, source, 0

    @property
    def at_end(self) -> bool:
        return self._next >= len(self._tokens)

    def package(self) -> Package:
        """Read ``PACKAGE … END name;``."""
        self._expect("package")
        name = self._qualified_name()
        self._expect("public")
        imports: list[str] = []
        while self._accept("with"):
            imports.append(self._qualified_name())
            while self._accept(","):
                imports.append(self._qualified_name())
            self._expect(";")
        components = []
        while self._peek() not in ("end", "properties"):
            components.append(self._component())
        properties = self._properties("end") if self._accept("properties") else ()
        self._end(name)
        return Package(name, tuple(imports), tuple(components), properties)

    def _component(self) -> Component:
        category = self._take().meaning
        if (category, self._peek()) in _CATEGORIES_OF_TWO:
            category = f"{category} {self._take().meaning}"
        elif category not in _CATEGORIES:
            self._next -= 1
            raise self._error("a component: " + ", ".join(_CATEGORIES))
        is_implementation = self._accept("implementation")
        name = self._qualified_name()
        sections: dict[str, tuple[Item, ...]] = {}
        properties: tuple[Property, ...] = ()
        while (section := self._peek()) in _SECTIONS:
            self._take()
            if section == "properties":
                properties += self._properties(*_SECTIONS, "end")
            else:
                sections[section] = sections.get(section, ()) + self._items()
        self._end(name)
        return Component(category, name, is_implementation, **sections, properties=properties)

    def _items(self) -> tuple[Item, ...]:
        items = []
        while self._peek() not in (*_SECTIONS, "end"):
            if self._accept("none"):
                self._expect(";")
                continue
            name = self._name()
            self._expect(":")
            words = []
            while self._peek() not in (";", "{"):
                words.append(self._take().text)
            properties: tuple[Property, ...] = ()
            if self._accept("{"):
                properties = self._properties("}")
                self._expect("}")
            self._expect(";")
            items.append(Item(name, _joined(words), properties))
        return tuple(items)

    def _properties(self, *ends: str) -> tuple[Property, ...]:
        properties = []
        while self._peek() not in ends:
            if self._accept("none"):
                self._expect(";")
                continue
            name = self._qualified_name()
            self._expect("=>")
            value = []
            while self._peek() not in (";", "{", "}"):
                value.append(self._take().text)
            self._expect(";")
            properties.append(Property(name, _joined(value)))
        return tuple(properties)

    def _end(self, name: str) -> None:
        self._expect("end")
        line = self._line()
        found = self._qualified_name()
        if found.lower() != name.lower():
            raise InputError(f"{self._source}:{line}: END {found}, expected END {name}")
        self._expect(";")

    def _qualified_name(self) -> str:
        name = self._name()
        while self._peek() in _TIGHT:
            name += self._take().text + self._name()
        return name

    def _name(self) -> str:
        if not re.match(r"[A-Za-z_]", self._peek()):
            raise self._error("a name")
        return self._take().text

    def _peek(self) -> str:
        return "" if self.at_end else self._tokens[self._next].meaning

    def _line(self) -> int:
        return self._tokens[min(self._next, len(self._tokens) - 1)].line

    def _take(self) -> Token:
        if self.at_end:
            raise self._error("more text")
        self._next += 1
        return self._tokens[self._next - 1]

    def _accept(self, meaning: str) -> bool:
        if self._peek() == meaning:
            self._next += 1
            return True
        return False

    def _expect(self, meaning: str) -> None:
        if not self._accept(meaning):
            raise self._error(repr(meaning))

    def _error(self, expected: str) -> InputError:
        found = "the end of the file" if self.at_end else repr(self._tokens[self._next].text[:40])
        return InputError(f"{self._source}:{self._line()}: found {found}, expected {expected}")


def _joined(words: list[str]) -> str:
    """Return words as a text, in which the parts of names are not separated."""
    text, previous = "", ""
    for word in words:
        is_tight = word in (*_TIGHT, ")", ",") or previous in (*_TIGHT, "(", "")
        text += word if is_tight else f" {word}"
        previous = word
    return text


def view_text(view: View) -> str:
    """Return a view as the text of a file."""
    lines = [f"--! {note}" for note in view.notes]
    for package in view.packages:
        lines += ["", *_package_lines(package)]
    return "\n".join(lines).lstrip("\n") + "\n"


def _package_lines(package: Package) -> Iterator[str]:
    yield f"PACKAGE {package.name}"
    yield "PUBLIC"
    yield ""
    for name in package.imports:
        yield f"WITH {name};"
    for component in package.components:
        yield ""
        yield from _component_lines(component)
    if package.properties:
        yield ""
        yield "PROPERTIES"
        yield from (f"  {line}" for line in _property_lines(package.properties))
    yield f"END {package.name};"


def _component_lines(component: Component) -> Iterator[str]:
    kind = " IMPLEMENTATION" if component.is_implementation else ""
    yield f"{component.category.upper()}{kind} {component.name}"
    for section in ("features", "subcomponents", "connections"):
        items: tuple[Item, ...] = getattr(component, section)
        if items:
            yield section.upper()
        for item in items:
            start = f"  {item.name} : {item.content}"
            if item.properties:
                yield f"{start} {{"
                yield from (f"    {line}" for line in _property_lines(item.properties))
                yield "  };"
            else:
                yield f"{start};"
    if component.properties:
        yield "PROPERTIES"
        yield from (f"  {line}" for line in _property_lines(component.properties))
    yield f"END {component.name};"


def _property_lines(properties: tuple[Property, ...]) -> Iterator[str]:
    return (f"{p.name} => {p.value};" for p in properties)
