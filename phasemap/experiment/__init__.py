"""The experiment as a user describes it: a sample, a microscope, and how it is operated.

A sample is a `surface` of `material`: `surface_maps` checks its maps, `labels` looks materials up, `generate` makes
patterns, and a tip of finite size sees another surface (`seen_by_tip`). A `microscope` is a lever, a tip, a drive and
the forces of `interaction`; `presets` have usual ones. How it scans is in `control`, how exact the answer has to be in
`accuracy`, and what a real instrument adds in `realism`.
"""
