"""Where a percept table comes from: package, settings, recordings, command, classifier."""

import hashlib
import inspect
import sys
from dataclasses import fields
from pathlib import Path
from typing import Any

from meal_bayes.datasets import Dataset
from meal_bayes.datasets.sources import SOURCES
from meal_bayes.perception.settings import PerceptionSettings
from meal_bayes.version import package_version


def provenance_of(dataset: Dataset, settings: PerceptionSettings) -> dict[str, str]:
    """Return what identifies the inputs of a percept table."""
    digest = hashlib.sha256(dataset.labels.tobytes())
    for context, values in sorted(dataset.features.items()):
        digest.update(repr(context).encode())
        digest.update(values.tobytes())
    data, kind = dataset.domain.data, type(settings.classifier)
    home = SOURCES.get(data)
    options = {
        "paper": " --perception paper",
        "classifier": f" --classifier {kind.__module__}:{kind.__qualname__}",
    }
    values_of = {
        field.name: getattr(settings, field.name)
        for field in fields(settings)
        if field.name != "classifier"  # it has entries of its own
    }
    return {
        "package": f"meal-bayes {package_version()}",
        "perception": _listed(values_of),
        "source": f"{home.repository}@{home.commit}" if home else "own data",
        "recordings_sha256": digest.hexdigest(),
        "command": f"meal-bayes data percepts --dataset {data}{options.get(settings.method, '')}",
        **_classifier_provenance(settings.classifier),
    }


def _classifier_provenance(classifier: Any) -> dict[str, str]:
    """Return a classifier's parameters, and the source or the package it comes from."""
    if classifier is None:
        return {}
    kind = type(classifier)
    package = kind.__module__.partition(".")[0]
    parameters = {name: repr(value) for name, value in sorted(classifier.get_params().items())}
    found = {
        "classifier": f"{kind.__module__}:{kind.__qualname__}",
        "classifier_parameters": _listed(parameters),
    }
    version = getattr(sys.modules.get(package), "__version__", None)
    if isinstance(version, str):
        return {**found, "classifier_package": f"{package} {version}"}
    return {**found, "classifier_source_sha256": _source_digest(kind)}


def _listed(values: dict[str, Any]) -> str:
    return ", ".join(f"{name}={value}" for name, value in values.items())


def _source_digest(kind: type) -> str:
    try:
        source = Path(inspect.getfile(kind)).read_bytes()
    except (OSError, TypeError):  # typed at a prompt
        return "unknown"
    return hashlib.sha256(source).hexdigest()
