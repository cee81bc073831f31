"""The corpus of attacks: there are many, and the page on trust lists them all."""

from attack_table import NAME, PAGE, attack_table

from benchmark.corpus import CORPUS


def test_there_are_many_attacks_and_each_has_a_name_of_its_own() -> None:
    named = [(what, name) for what, names in CORPUS.items() for name in names]
    assert len(named) >= 25
    assert all(len(names) == len(set(names)) and names for names in CORPUS.values())


def test_what_was_measured_before_is_among_them() -> None:
    named = {name for names in CORPUS.values() for name in names}
    assert named >= {
        "lingers in the first tenth, 0.3",
        "rides at 0.88",
        "rides at 0.95",
        "recognises a stored episode by its first observation, or is honest",
        "reads the frames that call it and edits what is recorded",
        "finds what is recorded with gc",
        "a subclass that denies it",
        "an error below 0",
        "completed seven times",
        "a copy as a training seed",
        "a callable that repeats an identity",
        "other weights under the same card",
        "a broken file",
        "rides 157 mm beside the path",
        "a compiled law that returns NaN",
    }


def test_the_page_lists_them() -> None:
    assert f"<!-- {NAME} -->\n{attack_table()}<!-- /{NAME} -->\n" in PAGE.read_text("utf-8")
