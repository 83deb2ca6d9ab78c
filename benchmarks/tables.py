"""Tables of measured figures, as text: what stands in a cell is what a page shows."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Table:
    """A table that a benchmark measured.

    Attributes
    ----------
    head
        Names of the columns; the first name what a row is about.
    rows
        Cells as they are shown.
    measured, machine
        Date (year-month-day) and kind of machine.
    """

    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    measured: str = ""
    machine: str = ""

    @classmethod
    def of(cls, head: Sequence[str], rows: Iterable[Sequence[object]]) -> Table:
        """Make a table of values: numbers are rounded to what is worth reading."""
        return cls(tuple(head), tuple(tuple(cell(value) for value in row) for row in rows))

    def column(self, name: str) -> list[str]:
        """Return the cells of a column; KeyError where there is none."""
        if name not in self.head:
            raise KeyError(f"no column '{name}'; there are {', '.join(self.head)}")
        return [row[self.head.index(name)] for row in self.rows]

    def numbers(self, name: str) -> list[float]:
        """Return the cells of a column as numbers."""
        return [float(text.replace(",", "")) for text in self.column(name)]

    def only(self, **cells: str) -> Table:
        """Return the rows with these cells."""
        kept = [row for row in self.rows if all(row[self.head.index(name)] == cell for name, cell in cells.items())]
        return replace(self, rows=tuple(kept))

    def cell(self, row: str, column: str) -> str:
        """Return one cell; `row` lists cells, separated by ", ", that single the row out.  KeyError where none is."""
        wanted = row.split(", ")
        found = [number for number, cells in enumerate(self.rows) if cells[0] == row or set(wanted) <= set(cells)]
        if len(found) != 1:
            raise KeyError(f"'{row}' is in {len(found)} rows")
        return self.column(column)[found[0]]

    def markdown(self, columns: Sequence[str] = ()) -> str:
        """Return the table, or some of its columns, in Markdown; all but the first stand to the right."""
        names = list(columns or self.head)
        lines = ["| " + " | ".join(names) + " |", "| --- |" + " ---: |" * (len(names) - 1)]
        lines += ["| " + " | ".join(row) + " |" for row in zip(*(self.column(name) for name in names), strict=True)]
        return "\n".join(lines) + "\n"


def cell(value: object) -> str:
    """Return a value as a table shows it."""
    if not isinstance(value, float):
        return f"{value:,}" if isinstance(value, int) else str(value)
    if value != 0.0 and abs(value) < 0.05:
        return f"{value:.2e}"
    return f"{value:.0f}" if abs(value) >= 20.0 else f"{value:.2f}"
