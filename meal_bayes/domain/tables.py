"""Read domains of the package by name, and your own from a TOML file or a dictionary.

Keys, with their defaults in brackets:

name, attributes
    Name of the domain, and attributes about which a person can ask.
sources
    For each modality: topic, feature, fields [those of the message type], encoding ["s16le", for
    sound], pixels [10000] and settings of the feature [its defaults]; see `meal_bayes.features`.
behaviors
    Rows of name, cost (s), modalities [none] and answer_accuracy [the behavior asks nobody].
diagram
    states, start, illegal ["terminate", or "stay"], labels of the states, which people read [their
    names], and effects: rows of from, do, to, probability [1] and senses [true]. "*" is every
    state in from, and the same state in to.
report_reward, predefined, legal_budget, asked_minimum, groups, synonyms, data
    As in `Domain`, with its defaults.
payoffs
    right_yes, wrong_yes, right_no and wrong_no, if yes and no have different rewards.
extends
    A domain of the package, or another TOML file, whose keys this table replaces.
note
    A remark for readers.
"""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, cast

from meal_bayes.arrays import plain
from meal_bayes.domain.diagram import TERMINAL, Effect, TransitionDiagram
from meal_bayes.domain.domain import Behavior, Domain
from meal_bayes.domain.event import Payoffs
from meal_bayes.domain.words import fold, unknown
from meal_bayes.errors import DomainError, QueryError, SettingsError
from meal_bayes.files import checked_path, path_text
from meal_bayes.untrusted import (
    DIAGRAM_LIMIT,
    LINE_LIMIT,
    NAME_LIMIT,
    TABLE_LIMIT,
    check_depth,
    name_fault,
    read_bytes,
)

_TABLES = Path(__file__).parent / "tables"  # that ship
_TEXT = "a text"
_NUMBER = "a number"
_LIST = "a list of texts"
_TABLE = "a table"
_ROWS = "rows"
_NUMBERS = "a list of numbers"
_COUNT = "a whole number, 0 or more"
_FLAG = "true or false"
_TYPES = {_TEXT: str, _TABLE: dict, _FLAG: bool}
_PARTS = {_LIST: _TEXT, _ROWS: _TABLE, _NUMBERS: _NUMBER}
_DOMAIN_KEYS = {
    "name": _TEXT, "data": _TEXT, "note": _TEXT, "attributes": _LIST, "groups": _TABLE,
    "synonyms": _TABLE, "predefined": _LIST, "report_reward": _NUMBER, "legal_budget": _NUMBERS,
    "asked_minimum": _COUNT, "payoffs": _TABLE, "behaviors": _ROWS,
    "diagram": _TABLE, "sources": _TABLE,
}  # fmt: skip
_DIAGRAM_KEYS = {
    "states": _LIST, "start": _TEXT, "effects": _ROWS, "illegal": _TEXT, "labels": _LIST,
}  # fmt: skip
_BEHAVIOR_KEYS = {
    "name": _TEXT, "cost": _NUMBER, "modalities": _LIST, "answer_accuracy": _NUMBER,
}  # fmt: skip
_SOURCE_KEYS = {
    "topic": _TEXT, "feature": _TEXT, "fields": _LIST, "encoding": _TEXT, "settings": _TABLE,
    "pixels": _COUNT,
}  # fmt: skip
# Fields of `Effect` by key; others are called as their keys.
_EFFECT_FIELDS = {"from": "source", "do": "behavior", "to": "target"}
_EFFECT_KEYS = {
    "from": _TEXT, "do": _TEXT, "to": _TEXT, "probability": _NUMBER, "senses": _FLAG,
}  # fmt: skip


def domain_names() -> tuple[str, ...]:
    """Return the names of the package's domains."""
    return tuple(sorted(path.stem for path in _TABLES.glob("*.toml")))


def load_domain(name: str | Path | Mapping[str, Any] | Domain) -> Domain:
    """Load a shipped domain by its name, or your own from a TOML file or a dictionary.

    Every function with a parameter `domain` accepts the same values as `name`. A table may extend
    another one, as in ``extends = "roc36"``; its keys then replace those of the other table.

    Parameters
    ----------
    name : str | Path | Mapping[str, Any] | Domain
        Name of a shipped domain, path of a TOML file, the content of such a file as a dictionary,
        or a `Domain`, which is returned unchanged.

    Raises
    ------
    SettingsError
        No shipped domain and no file has this name.
    DomainError
        The file or the dictionary is not a valid domain.

    Examples
    --------
    >>> load_domain({"extends": "toy", "name": "toy_of_two", "report_reward": 7}).report_reward
    7.0
    """
    if isinstance(name, Domain):
        return name
    if isinstance(name, Mapping):
        table = dict(name)
        name = str(name.get("name", "of a dictionary"))
    else:
        name = cast("str", path_text(name))
        table = _read(name)
    # The table that names the next parent: paths are relative to its own folder.
    source = str(name)
    seen = {str(name)}
    while "extends" in table:
        parent = str(table.pop("extends"))
        if parent.endswith(".toml") and source.endswith(".toml"):
            parent = str(Path(source).parent / str(path_text(parent)))
        if parent in seen:
            raise DomainError(f"Domain {name} extends itself through {parent!r}.")
        seen.add(parent)
        table = {**_read(parent), **table}
        source = parent
    try:
        return domain_from_table(table)
    except DomainError as error:
        raise DomainError(f"Domain {name}: {error}") from error


def domain_from_table(table: object) -> Domain:
    """Build a domain from the content of a TOML file without `extends`, or from the same in JSON.

    Raises
    ------
    DomainError
        The file or the dictionary is not a valid domain.
    """
    table = plain(table)
    if not isinstance(table, dict):
        raise DomainError(f"A domain is a table of keys; found {type(table).__name__}.")
    # Keys and forms first, then sizes: `Domain` checks what the values mean together.
    required = ("name", "attributes", "behaviors", "diagram")
    fields = _checked_fields("the domain", table, _DOMAIN_KEYS, required)
    if "payoffs" in table:
        four = dict.fromkeys(Payoffs._fields, _NUMBER)
        stated = _checked_fields("[payoffs]", table["payoffs"], four, Payoffs._fields)
        try:
            fields["payoffs"] = Payoffs.of([stated[name] for name in Payoffs._fields])
        except QueryError as error:
            raise DomainError(str(error)) from None
    diagram = _checked_fields(
        "[diagram]", table["diagram"], _DIAGRAM_KEYS, ("states", "start", "effects")
    )
    _check_sizes(table)
    for part, form in (("groups", _LIST), ("synonyms", _TEXT)):
        entries = table.get(part, {})
        fields[part] = _checked_fields(f"[{part}]", entries, dict.fromkeys(entries, form), ())
    sources = _checked_fields(
        "[sources]", table.get("sources", {}), dict.fromkeys(table.get("sources", {}), _TABLE), ()
    )
    fields["sources"] = {
        name: _checked_fields(f"[sources.{name}]", row, _SOURCE_KEYS, ("topic", "feature"))
        for name, row in sources.items()
    }
    behaviors = list[Behavior]()
    effects = list[Effect]()
    for row in table["behaviors"]:
        where = f"behavior {row.get('name', row)!r}"
        behaviors.append(Behavior(**_checked_fields(where, row, _BEHAVIOR_KEYS, ("name", "cost"))))
    for row in diagram["effects"]:
        arrow = _checked_fields(f"effect {row}", row, _EFFECT_KEYS, ("from", "do", "to"))
        effects.append(
            Effect(**{_EFFECT_FIELDS.get(key, key): value for key, value in arrow.items()})
        )
    fields["behaviors"] = tuple(behaviors)
    diagram["effects"] = tuple(effects)
    diagram["states"] += (TERMINAL,)
    fields.pop("note", None)
    return Domain(**{**fields, "diagram": TransitionDiagram(**diagram)})


def domain_table(domain: Domain) -> dict[str, Any]:
    """Return the table (JSON values) from which `domain_from_table` builds an equal domain.

    >>> domain_from_table(domain_table(load_domain("toy"))) == load_domain("toy")
    True
    """
    table = asdict(domain)
    if not domain.sources:  # of most domains; their digests stay what they were
        del table["sources"]
    payoffs = table.pop("payoffs")
    if payoffs is not None:
        table["payoffs"] = payoffs._asdict()
    table["behaviors"] = [
        {key: value for key, value in row.items() if value is not None}
        for row in table["behaviors"]
    ]
    diagram = table["diagram"]
    diagram["states"] = diagram["states"][:-1]
    if not diagram["labels"]:
        del diagram["labels"]
    diagram["effects"] = [
        {key: effect[_EFFECT_FIELDS.get(key, key)] for key in _EFFECT_KEYS}
        for effect in diagram["effects"]
    ]
    return table


def with_attribute(domain: Domain, name: str, values: Sequence[str] = ()) -> Domain:
    """Return a domain that has one more attribute, or one more group with its values.

    Parameters
    ----------
    domain : Domain
        Domain to extend. Its attributes keep their order, and the new ones follow them.
    name : str
        Name of the attribute or of the group.
    values : Sequence[str]
        Values of the group, at least two; empty for a single attribute.

    Raises
    ------
    DomainError
        The domain already has the name, or the name is not valid.

    Examples
    --------
    >>> with_attribute(load_domain("toy"), "size", ["small", "large"]).attributes
    ('red', 'heavy', 'small', 'large')
    """
    if fault := name_fault(name):
        raise DomainError(f"The name {name!a:.60} {fault}; rename it.")
    if isinstance(values, str):
        raise DomainError(f"The values of {name!r} are {values!r:.60}; give a list of names.")
    if name in domain.groups or fold(name) in domain.words:
        raise DomainError(f"The domain {domain.name!r} has {name!r} already; give another name.")
    table = domain_table(domain)
    table["attributes"] = [*table["attributes"], *(values or [name])]
    if values:
        table["groups"] = {**table["groups"], name: [*values]}
    return domain_from_table(table)


def _read(name: str | Path) -> dict[str, Any]:
    path = checked_path("The domain", name)
    if not str(name).endswith(".toml"):
        if name not in domain_names():
            message = unknown("domain", str(name), domain_names())
            raise SettingsError(
                f"{message} The path of your own domain ends in .toml, and that of a percept "
                "table in .npz."
            )
        path = _TABLES / f"{name}.toml"
    try:
        text = read_bytes(path, TABLE_LIMIT).decode("utf-8-sig")
        longest = max(map(len, text.split("\n")))
        if longest > LINE_LIMIT:
            raise ValueError(f"it has a line of {longest:,} characters")  # noqa: TRY301
        table = tomllib.loads(text)
        check_depth(table)  # raises as the parser does, whatever depth that may go to
    except RecursionError:
        raise DomainError(f"{path} is no domain table: it is nested too deeply.") from None
    except OSError as error:
        why = f"cannot be read ({error.strerror}); give the path of a domain table (TOML)"
        raise SettingsError(f"{path} {why}.") from error
    except ValueError as error:  # also TOMLDecodeError and UnicodeDecodeError
        raise DomainError(f"{path} is not valid TOML: {error}.") from error
    return table


def _check_sizes(table: dict[str, Any]) -> None:
    """Raise an error if there are too many names, or if a name or the diagram is too large."""
    diagram = table["diagram"]
    names = [table["name"], table.get("data", table["name"])]
    for key in ("attributes", "behaviors", "groups", "synonyms", "states", "labels"):
        entries = (diagram if key in _DIAGRAM_KEYS else table).get(key, ())
        if len(entries) > NAME_LIMIT:
            raise DomainError(f"{len(entries)} {key}; expected at most {NAME_LIMIT}.")
        names += [row.get("name") if isinstance(row, dict) else row for row in entries]
    for name in names:  # what is no text is refused where the field is read
        if isinstance(name, str) and (fault := name_fault(name)):
            raise DomainError(f"The name {name[:60]!a} {fault}; rename it.")
    e = len(table["behaviors"])
    x = len(diagram["states"])
    arrows = len(diagram["effects"])
    if max(e * (x + 1) ** 2, arrows * x) > DIAGRAM_LIMIT:
        parts = f"{e} behaviors, {x} states and {arrows} effects"
        raise DomainError(f"{parts} make more than {DIAGRAM_LIMIT:,} entries; use fewer of them.")


def _checked_fields(
    where: str, row: dict[str, Any], forms: dict[str, str], required: tuple[str, ...]
) -> dict[str, Any]:
    """Check the keys of a table and the types of its values; return the values as fields."""
    for key in required:
        if key not in row:
            raise DomainError(f"{where} has no {key!r}; add it.")
    fields = {}
    for key, value in row.items():
        if key not in forms:
            raise DomainError(f"In {where}: {unknown('key', key, sorted(forms))}")
        try:
            fields[key] = _read_value(forms[key], value)
        except (TypeError, OverflowError) as error:  # of a whole number, which says that it is
            message = f"In {where}: {key} = {value!r:.60}; expected {forms[key]}. {error}"
            raise DomainError(message.strip()) from None
    return fields


def _read_value(form: str, value: Any) -> Any:
    """Return a TOML value as the value of a field; raise a `TypeError` if its type is wrong."""
    if form in _PARTS and isinstance(value, list | tuple):
        return tuple(_read_value(_PARTS[form], part) for part in value)
    if form == _NUMBER and isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    whole = form == _COUNT and type(value) is int and value >= 0
    if not (whole or isinstance(value, _TYPES.get(form, ()))):
        raise TypeError
    return value
