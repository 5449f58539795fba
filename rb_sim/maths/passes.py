"""numba's passes over an inner function, those left out that no kernel needs.

Left out: closures, comprehensions and `with` blocks in a kernel, `literal_unroll`, inlining of
numba's own code and fused expressions on whole arrays; each of them walks every function.
"""

from __future__ import annotations

from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import PassManager
from numba.core.typed_passes import NopythonTypeInference, PreLowerStripPhis
from numba.core.untyped_passes import (
    DeadBranchPrune,
    FixupArgs,
    GenericRewrites,
    IRProcessing,
    ReconstructSSA,
    RewriteSemanticConstants,
    TranslateByteCode,
)

PASSES = (
    TranslateByteCode,
    FixupArgs,
    IRProcessing,
    RewriteSemanticConstants,
    DeadBranchPrune,
    GenericRewrites,
    ReconstructSSA,
    NopythonTypeInference,
    PreLowerStripPhis,
)


class InnerCompiler(CompilerBase):
    """The PASSES, then numba's lowering."""

    def define_pipelines(self) -> list[PassManager]:
        manager = PassManager("inner")
        for one in PASSES:
            manager.add_pass(one, one.__name__)
        lowering = DefaultPassBuilder.define_nopython_lowering_pipeline(self.state)
        manager.passes.extend(lowering.passes)
        manager.finalize()
        return [manager]
