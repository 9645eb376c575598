"""Files: images written and read as netCDF, measured images of any microscope, and exports to other programs.

`read` brings a file into the one form that phasemap works on: `gwyddion` loads its channels, `metadata` knows what
vendors call them, `vendors` what they say of the scan; what a new vendor's files need goes there. `curves` does so for
amplitude and phase against distance. `measured` makes materials and level maps of an image; `netcdf` and `export` write
it, at once or not at all.
"""
