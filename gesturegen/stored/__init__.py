"""Files stored between commands: written with a checksum, and checked once, on reading, against a declaration.

Arrays are declared as a `Kind` beside the code that uses them, JSON files as models in `documents`.
"""
