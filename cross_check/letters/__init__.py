"""Letters: the combinations of answers that an event can give to some questions, each with an event that gives them."""

from cross_check.letters.combinations import (
    UNBOUND,
    VARIABLES,
    Answers,
    Letters,
    answers,
    letters,
    ties,
    untied,
    with_twins,
)

__all__ = ["UNBOUND", "VARIABLES", "Answers", "Letters", "answers", "letters", "ties", "untied", "with_twins"]
