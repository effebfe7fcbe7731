"""Reports: what flights are judged by (summaries, tables, findings with intervals, the bound) and
self-contained HTML pages of text, tables and figures.

Takes flights and measured logs of `sim`; knows no study and no command.

Imports: laisn sim
"""
