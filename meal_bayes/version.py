"""The version of the installed package."""


def package_version() -> str:
    """Return the version, "unreleased" where the package is not installed."""
    from importlib import metadata  # noqa: PLC0415  costs as much as the package's own import

    try:
        return metadata.version("meal-bayes")
    except metadata.PackageNotFoundError:
        return "unreleased"
