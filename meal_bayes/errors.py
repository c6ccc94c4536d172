"""The one family of errors a user meets.

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
    """A recording, label or percept file that does not hold what its layout promises."""


class DownloadError(MealBayesError):
    """A file that cannot be had: no network and no cache, or a checksum that differs."""


class RobotError(MealBayesError):
    """Error raised if a robot does not behave as promised, such as by an unknown state.

    Examples
    --------
    >>> import meal_bayes
    >>> isinstance(meal_bayes.RobotError("the gripper jams"), meal_bayes.MealBayesError)
    True
    """


class ConformanceError(MealBayesError):
    """A solver, robot or classifier that does not keep to what `meal_bayes.testing` checks."""


class OutputError(MealBayesError):
    """A file that cannot be written: its place, the disk, or what it would replace."""


class LogError(MealBayesError):
    """A trial log that cannot be used."""


class LogCorruptError(LogError):
    """A trial log with bytes that are torn or changed."""


class LogVersionError(LogError):
    """A trial log written in another format version."""


class ImpossibleObservation(MealBayesError):  # the field's word for it
    """A percept that has probability zero under every attribute value still believed in."""
