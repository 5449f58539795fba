"""Python functions of numbers, vectors and tables made machine code, once for all scenes.

A small part of Python is enough for loops: numbers, tuples, arrays, `for` over ranges, `while`,
branches and calls. The functions stay plain Python, which runs as it is with RB_SIM_INTERPRETED=1;
compiled, all that one of them calls becomes one module of LLVM IR, optimised as a whole:

    source      the syntax tree of a function, what it takes and returns
    kinds       what a value can be, and of which LLVM values it consists
    builder     blocks and instructions of a function as text
    arithmetic  conversions, operators, comparisons
    arrays      elements, parts, new arrays
    calls       what calls mean that are not calls of functions compiled with their callers
    translate   variables, expressions and statements
    unit        a module: translated, optimised, machine code
    marshal     arguments of Python's, and back
    program     entries that Python or C calls, kept on disk
"""
