# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Compiler of Python functions of numbers, vectors and tables to machine code, once for all scenes.

Loops need a small part of Python only: numbers, tuples, arrays, `for` over ranges, `while`,
branches and calls. The functions stay plain Python and run as such with RB_SIM_INTERPRETED=1;
compiled, a function and all that it calls become one module of LLVM IR, optimised as a whole:

    source      syntax tree of a function, its arguments and its result
    builder     kinds of values, blocks and instructions of a function as text
    arithmetic  conversions, operators, comparisons
    arrays      elements, parts, new arrays
    calls       compiled meaning of calls of library functions
    translate   variables, expressions and statements
    unit        a module: translation, optimisation, machine code
    program     entries that Python or C calls, kept on disk
    ship        compiles the loops that are shipped, for each kind of machine
    shipped     machine code of loops that comes with the package
"""
