"""Log lines of a unit: what is passed on at once, at the end, or taken back."""

import pytest

from flexbeams.scenarios.simulation.messages import MAX_KINDS, MAX_SHOWN, Messages


@pytest.fixture
def heard() -> list[str]:
    return []


@pytest.fixture
def messages(heard: list[str]) -> Messages:
    return Messages("a", heard.append)


def test_warnings_come_at_once_and_then_as_a_count(messages: Messages, heard: list[str]) -> None:
    for k in range(MAX_SHOWN + 2):
        messages.add(f"step at {k} s", warning=True)
        assert len(heard) == min(k + 1, MAX_SHOWN)
    messages.add("other", warning=True)
    messages.add("other", warning=True)
    messages.finish()
    assert heard[:MAX_SHOWN] == [f"a: step at {k} s" for k in range(MAX_SHOWN)]
    assert heard[MAX_SHOWN:] == ["a: other", f"a: step at 0 s ({MAX_SHOWN + 2} times)", "a: other (2 times)"]


def test_a_line_that_a_failure_quotes_is_taken_back(messages: Messages, heard: list[str]) -> None:
    messages.add("cannot go on at 1.5 s", warning=False)
    messages.forget("cannot go on at 1.5 s")
    messages.forget("never said")
    messages.finish()
    assert heard == []
    for time in ("1", "2"):
        messages.add(f"cannot go on at {time} s", warning=False)
    messages.forget("cannot go on at 2 s")
    messages.finish()
    assert heard == ["a: cannot go on at 1 s"]


def test_lines_of_many_kinds_are_counted_together(messages: Messages, heard: list[str]) -> None:
    for k in range(MAX_KINDS + 5):
        messages.add("line " + "x" * k, warning=True)
    messages.finish()
    assert len(heard) == MAX_KINDS + 1
    assert heard[-1] == "a: further lines (5 times)"
    heard.clear()
    messages.finish()
    assert heard == []
