"""Outcomes <-> message bytes: the compact form, columns of many trials in one message."""

from typing import Any

import numpy as np

from meal_bayes.errors import LogCorruptError
from meal_bayes.trial_log.schema import NAME_LIMIT, OutcomesMessage
from meal_bayes.trials.outcomes import INTEGERS, REALS, TEXTS, TrialOutcomes


def encode_outcomes(outcomes: TrialOutcomes, first: int) -> bytes:
    """Pack outcomes; `first` is the number of their first trial in the file."""
    places: dict[str, int] = {}
    columns: dict[str, Any] = {
        name: [places.setdefault(text, len(places)) for text in getattr(outcomes, name).flat]
        for name in TEXTS
    }
    columns |= {name: getattr(outcomes, name).ravel().tolist() for name in INTEGERS | REALS}
    packed: bytes = OutcomesMessage(
        first=first,
        trials=len(outcomes),
        queried=outcomes.attribute.shape[1],
        texts=list(places),
        behaviors=outcomes.behaviors,
        **columns,
    ).SerializeToString()
    return packed


def decode_outcomes(data: bytes) -> tuple[int, TrialOutcomes]:
    """Read outcomes, and the number of their first trial in the file."""
    message = OutcomesMessage.FromString(data)
    size = {"n": message.trials, "q": message.queried, "e": len(message.behaviors)}
    if min(message.first, *size.values()) < 0 or max(size["q"], size["e"]) > NAME_LIMIT:
        raise LogCorruptError(f"outcomes {message.first} of sizes {size}")
    columns: dict[str, Any] = {}
    for name, shape in (TEXTS | INTEGERS | REALS).items():
        found = np.array(getattr(message, name), np.float64 if name in REALS else np.int64)
        columns[name] = found.reshape([size[letter] for letter in shape])
    texts = np.array(message.texts, object)
    for name in TEXTS:
        if columns[name].size and not 0 <= columns[name].min() <= columns[name].max() < len(texts):
            raise LogCorruptError(f"outcomes name a text that is not there ({name})")
        columns[name] = texts[columns[name]]
    return message.first, TrialOutcomes(tuple(message.behaviors), **columns)
