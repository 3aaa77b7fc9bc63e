"""Foreign recordings: readers of tables and scenarios, and advercity's own table.

`track_file` has a road's table, also for specs; `recorded_tables` and `openscenario` are readers.
"""
