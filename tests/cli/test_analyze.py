"""What `rb_sim analyze` prints."""

from __future__ import annotations

from rb_sim.cli import analyze


def told(count: int) -> dict:
    row = {"least": -1.0, "largest": 1.0, "rms": 0.5, "peak_frequency": None}
    source = {"count": 7, "rate": 50.0, "gaps": 0, "backwards": 0, "values": {"x": row}}
    return {
        "sources": {f"/robot{k}/pose": source for k in range(count)},
        "bodies": {f"/robot{k}/pose": {"note": "too few"} for k in range(count)},
        "balance": None,
        "balances": {},
        "constraints": None,
        "contacts": None,
    }


def test_the_terminal_shows_the_first_of_thousands(monkeypatch, capsys):
    """Laying out a table takes a millisecond a line; JSON has all of them."""
    monkeypatch.setattr(analyze, "SHOWN", 3)
    analyze._print(told(5))
    text = capsys.readouterr().out
    assert text.count("/robot") == 3 + 3 + 3 and "/robot3" not in text
    assert "and 2 more sources: --json and --out DIR tell all" in text
    assert "and 2 more bodies: --json and --out DIR tell all" in text
    analyze._print(told(3))
    assert "more" not in capsys.readouterr().out
