# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

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
