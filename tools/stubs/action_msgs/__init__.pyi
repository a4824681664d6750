# Written by tools/write_stubs.py from the interface files.
