"""Records in the files that labs keep: MATLAB, NumPy, HDF5, Excel, Parquet, Feather and TDMS.

Each format is one module that turns a file into tables of named columns; `reading` makes records
of them with the same names, units and messages as for CSV.
"""
