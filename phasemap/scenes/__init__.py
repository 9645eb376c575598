"""Scenes: one TOML file that says everything, from which a surface, a microscope and an image are made.

`tables` reads a file and complains of what it cannot mean, `surface` makes the sample, `objects` the microscope and its
settings, and `scene` puts them together. A scene may also come from a measured image (`measured`), or be many at once
(`ensemble`).
"""
