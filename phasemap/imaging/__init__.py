"""Images: from a surface and a microscope to a Dataset, under every control.

`simulation` is what a user calls; it makes a `job`, plans it after a survey of the `materials`, and fills
the `canvas` part by part: `engaged` pixel by pixel, `raster` along lines at rest, `feedback` in time. Where
nearly every pixel is another material, `interpolation` stands between; `checkpoint` keeps what is done, `dask`
holds what is larger than memory, `imperfections` adds what a real microscope does.
"""
