"""Long tables, a row for each reading of each tag: to one column for each tag."""

import numpy as np
import polars as pl

from plantfit.recording.readers.clock import guess_time
from plantfit.recording.readers.columns import Table, named_columns
from plantfit.recording.readers.numbers import casted, is_missing, mostly_numbers, refuse_both_marks

MOST = 100  # tags
FEWEST = 3  # readings of each
TOGETHER = 0.75  # times a reading at most: a column of modes or alarms has as many times as readings


def widened(table: Table) -> Table:
    """A long table with a column for each tag and a row for each time; any other table as it is.

    Long is a table of a time column, one column of texts of which each comes back in at least `FEWEST` rows, and one
    column of numbers, where most times have several readings and no tag has two at one time. A tag that was not read at
    a time is missing there.
    """
    if len(table.columns) != 3 or len(table.columns[0].cells) < 2 * FEWEST:
        return table
    time = guess_time(table)
    others = [c for c in table.columns if c is not time]
    tags = [c for c in others if c.cells.dtype == pl.String and not mostly_numbers(table, c)]
    if time is None or len(tags) != 1:
        return table
    (tag,) = tags
    (value,) = (c for c in others if c is not tag)
    names = [name.strip() if name else "" for name in tag.cells.to_list()]
    distinct = list(dict.fromkeys(names))
    counts = [names.count(name) for name in distinct[: MOST + 1]]
    values, text, *_ = casted(table, value.cells)
    if not 2 <= len(distinct) <= MOST or min(counts) < FEWEST or any(map(is_missing, distinct)) or len(text):
        return table
    moments = [str(cell) for cell in time.cells.to_list()]
    place = {moment: row for row, moment in enumerate(dict.fromkeys(moments))}
    rows, columns = np.array([place[m] for m in moments]), np.array([distinct.index(n) for n in names])
    if len(place) > TOGETHER * len(rows) or len({*zip(rows.tolist(), columns.tolist(), strict=True)}) < len(rows):
        return table
    for column in (time, value):  # while their texts still stand side by side
        if table.decimal == "auto" and casted(table, column.cells).comma:
            refuse_both_marks(table, column)
    wide = np.full((len(place), len(distinct)), np.nan)
    wide[rows, columns] = values
    first = np.unique(rows, return_index=True)[1]
    cells = [time.cells.gather(first.tolist()), *(pl.Series(name, wide[:, k]) for k, name in enumerate(distinct))]
    places = None if table.places is None else np.asarray(table.places)[first]
    log = (*table.log, f"A long table: the {len(distinct)} tags of {tag.header!r} became columns.")
    named = named_columns([time.header, *distinct], cells, [time.unit, *[None] * len(distinct)])
    return Table(table.source, named, places, table.place, table.decimal, True, log, table.left_out)
