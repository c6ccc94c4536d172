"""The command line: one file for each group of commands, which call the packages.

Packages and heavy libraries are imported inside the commands, so that `--help` answers at once.
Results go to standard output, progress and notes to standard error.
"""

import click

from meal_bayes.cli.ask import ask, demo, memory
from meal_bayes.cli.data import data
from meal_bayes.cli.doctor import doctor
from meal_bayes.cli.find import find
from meal_bayes.cli.log import compare, log, report
from meal_bayes.cli.posterior import export, posterior
from meal_bayes.cli.program import Program
from meal_bayes.cli.reproduce import reproduce
from meal_bayes.cli.run import run
from meal_bayes.cli.view import view


@click.group(
    cls=Program,
    commands=[
        demo,
        ask,
        find,
        memory,
        run,
        reproduce,
        view,
        report,
        compare,
        posterior,
        data,
        log,
        export,
        doctor,
    ],
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    epilog="Start with: meal-bayes demo",
)
@click.version_option(package_name="meal-bayes", message="meal-bayes %(version)s")
def main() -> None:
    """Choose which behaviors a robot tries before it answers a question about an object."""


__all__ = ["main"]
