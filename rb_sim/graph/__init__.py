"""Laws as graphs: a function on floats is run once on symbols and becomes straight-line code.

The package knows no physics.  `symbols` records operations, `functions` holds what a law may call
besides arithmetic, `emit` writes a graph as LLVM IR or as Python, `machine` makes code of it and
`store` keeps that on disk.
"""
