"""Phase contrast between two materials: its map, where it jumps and turns round, and where to work.

`pair` solves both materials over a grid, `edges` finds where the contrast jumps or changes its sign,
`recommendation` where it is large and safe. `contrast_map` is what a user calls, `dataset` what comes of it.
"""
