"""The command bench: what it prints. studies/bench.py measures."""


def line(
    quantity: str, value: float, unit: str, ratio: float, budget: float | None, ok: bool | None
) -> str:
    """A quantity, its value, its ratio to the yardstick, its budget, and whether the value keeps to
    it."""
    if budget is None:
        limit = ""
    else:
        limit = f"budget {budget:9,.0f}" if budget >= 100 else f"budget {budget:9g}"
    verdict = "" if ok is None else "ok" if ok else "MISSED"
    digits = 0 if value >= 1000 else 2
    measured = f"{quantity:86s} {value:12,.{digits}f} {unit:4s} {ratio:8.3g}"
    return f"{measured} {limit:16s} {verdict}".rstrip()
