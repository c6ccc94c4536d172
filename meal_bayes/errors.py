"""Errors of the package; all are derived from `MealBayesError`.

Every message says what was found, what was expected, and how to repair it.
"""


class MealBayesError(Exception):
    """Base class of all errors of the package; the command line prints them in one line.

    Examples
    --------
    >>> import meal_bayes
    >>> try:
    ...     meal_bayes.load_domain("rock36")
    ... except meal_bayes.MealBayesError as error:
    ...     print(type(error).__name__)
    SettingsError
    """


class SettingsError(MealBayesError):
    """An unknown name (data set, object, agent, ...) or a setting out of its range."""


class DomainError(MealBayesError):
    """A domain table (TOML) or transition diagram that is not well formed."""


class QueryError(MealBayesError):
    """A question that names no attribute, an unknown one, or the same one twice."""


class DataError(MealBayesError):
    """Recordings, labels or percepts that do not have the expected form."""


class DownloadError(MealBayesError):
    """A file that cannot be downloaded and is not in the cache, or that has a wrong checksum."""


class RobotError(MealBayesError):
    """Error raised if a robot breaks its protocol, for example by returning an unknown state.

    Examples
    --------
    >>> import meal_bayes
    >>> isinstance(meal_bayes.RobotError("the gripper jams"), meal_bayes.MealBayesError)
    True
    """


class ConformanceError(MealBayesError):
    """A solver or a robot that fails a check of `meal_bayes.testing`."""


class OutputError(MealBayesError):
    """A file that cannot be written because of its folder, the disk, or an existing file."""


class LogError(MealBayesError):
    """A trial log that cannot be used."""


class LogCorruptError(LogError):
    """A trial log that is cut off, or whose bytes were changed."""


class LogVersionError(LogError):
    """A trial log written in another format version."""


class ImpossibleObservation(MealBayesError):  # the field's word for it
    """A percept that has probability zero under every attribute value that is still possible."""
