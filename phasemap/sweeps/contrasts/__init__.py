"""Phase contrast between two materials: its map, where it jumps and turns round, and where to work.

`contrast_map` is what a user calls. `pair` solves both materials over a grid, and finds where the contrast jumps or
changes its sign; `result` makes the Dataset, and says where the contrast is large and safe.
"""
