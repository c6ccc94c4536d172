"""`python -m meal_bayes` is the command `meal-bayes`."""

from meal_bayes.cli import main

main(prog_name="meal-bayes")
