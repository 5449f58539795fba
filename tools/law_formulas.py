# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The equations of the laws as LaTeX, for their pages: what `Spec.EQUATION` says, typeset.

Bold letters are vectors; C is the centre of mass, A the parent or the world, B the body.
"""

from __future__ import annotations

FORMULAS = {
    "free": r"""
m\,\dot{\mathbf V} = \mathbf F , \qquad
\mathbf I\,\dot{\boldsymbol\omega} + \boldsymbol\omega\times\mathbf I\,\boldsymbol\omega
= R^{T}\mathbf K
""",
    "fixed_point": r"""
\mathbf p_B = \mathbf p_A , \qquad \mathbf V_B = \mathbf V_A , \qquad
\text{on the body: } \boldsymbol\lambda \text{ at } \mathbf p_B
""",
    "fixed_axis": r"""
\mathbf p_A = \mathbf p_{\mathrm{point\_A}} , \qquad
\mathbf e_B\cdot\mathbf s = \mathbf e_B\cdot\mathbf t = 0 , \qquad
J\,\ddot\varphi = K_n , \quad J = \mathbf n\cdot\mathbf I_O\,\mathbf n
""",
    "translation": r"""
\boldsymbol\omega = 0 , \qquad \mathbf p_B = \mathbf c(s) , \qquad
m\,\dot v = \mathbf F\cdot\boldsymbol\tau
""",
    "rolling": r"""
\mathbf n_A\cdot(\mathbf p_P - \mathbf p_A) = 0 , \qquad
\mathbf V + \boldsymbol\omega\times\mathbf r_{CP} = \mathbf V_A
""",
    "distance": r"""
|\mathbf p_B - \mathbf p_A| = \ell , \qquad
\mathbf F = \lambda\,\frac{\mathbf p_B - \mathbf p_A}{\ell}
""",
    "plane": r"""
\mathbf n_A\cdot(\mathbf p_B - \mathbf p_A) = 0 , \qquad \mathbf F = \lambda\,\mathbf n_A
""",
    "parallel": r"""
\mathbf e_B\cdot\mathbf s = \mathbf e_B\cdot\mathbf t = 0
""",
    "weld": r"""
\mathbf p_B = \mathbf p_A , \qquad q_{AB} = q_{AB}(0)
""",
    "velocity": r"""
\mathbf a\cdot\mathbf v_P + \mathbf b\cdot\boldsymbol\omega = c , \qquad
\mathbf F = \lambda\,\mathbf a , \quad \mathbf K = \lambda\,\mathbf b , \qquad
(\mathbf a, \mathbf b, c) = (\text{linear}, \text{angular}, \text{rate})
""",
    "contact": r"""
g \ge 0 , \quad N \ge 0 , \quad N g = 0 , \qquad
\dot g^{+} = -e\,\dot g^{-} , \qquad
\text{compliant: } N = \max\left(0,\; k\,\delta + c\,\dot\delta\right)
""",
    "string": r"""
g = \ell - |\mathbf p_B - \mathbf p_A| \ge 0 , \quad N \ge 0 , \quad N g = 0 , \qquad
\mathbf F = N\,\frac{\mathbf p_A - \mathbf p_B}{|\mathbf p_B - \mathbf p_A|}
""",
    "gravity": r"""
\mathbf F = m\,\mathbf g , \qquad U = -m\,\mathbf g\cdot\mathbf p_C
""",
    "linear_drag": r"""
\mathbf F = -c\,(\mathbf V - \mathbf V_{\mathrm{medium}})
""",
    "quadratic_drag": r"""
\mathbf F = -c\,|\mathbf V - \mathbf V_{\mathrm{medium}}|\,(\mathbf V - \mathbf V_{\mathrm{medium}})
""",
    "angular_damping": r"""
\mathbf K = -c\,(\boldsymbol\omega_B - \boldsymbol\omega_A)
""",
    "spring": r"""
\mathbf F = -k\,(\ell - \ell_0)\,\mathbf u - c\,(\mathbf u\cdot\dot{\mathbf d})\,\mathbf u , \qquad
U = \tfrac12 k\,(\ell - \ell_0)^2 , \qquad
\mathbf d = \mathbf p_B - \mathbf p_A = \ell\,\mathbf u
""",
    "torsion_spring": r"""
\mathbf K = -k\,(\theta - \theta_0)\,\nabla\theta
- c\,\big((\boldsymbol\omega_B - \boldsymbol\omega_A)\cdot\mathbf a\big)\,\mathbf a , \qquad
U = \tfrac12 k\,(\theta - \theta_0)^2
""",
    "wrench": r"""
\mathbf F = \mathbf F_0 + \mathbf F_1 \sin(\Omega t + \phi) , \qquad
\mathbf K = \mathbf K_0 + \mathbf K_1 \sin(\Omega t + \phi)
""",
    "wrench_table": r"""
\mathbf F(t) = \mathbf F_i + (\mathbf F_{i+1} - \mathbf F_i)\,\frac{t - t_i}{t_{i+1} - t_i} ,
\qquad t_i \le t < t_{i+1}
""",
    "commanded_wrench": r"""
(\mathbf F, \mathbf K) = \text{the last command}
""",
}
"""LaTeX of a display formula, by the kind of law."""
