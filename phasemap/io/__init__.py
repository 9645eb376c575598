"""Files: images written and read as netCDF, measured images of any microscope, and exports to other programs.

`read` brings a file into the one form that phasemap works on: `gwyddion` loads its channels, `kinds` knows what vendors
call them, `vendors` and `metadata` what they say of the scan; what a new vendor's files need goes there. `measured` and
`flattening` make materials and level maps of an image; `netcdf`, `export` and `exchange` write it, by
`whole_files` at once or not at all.
"""
