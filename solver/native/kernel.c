/* The whole kernel as one piece for the compiler, which scripts/build_native.py compiles once for each instruction set.
 */
#include "vectors.c"
#include "dictionary.c"
#include "domain_energy.c"
#include "frame.c"
#include "pursuit.c"
#include "sparse_fit.c"
#include "gauss_newton.c"
#include "placed.c"
#include "variable_projection.c"
#include "chunk.c"
#include "examine.c"
