"""The fitted constants of contact problems: what they were fitted on, and what they change.

Only speed depends on them, and whether a message or a jump appears; no solution does. What is
derived from rounding or theory stands beside its use. *Half* and *twice* say what happens at
half and at twice the value; `benches/tuning.py` measures those of the solver.
"""

# --- Choice of the engine in space: benches/scale.py, results/scale.csv and whole_job.csv.

# Free degrees of freedom from which the first load step takes less time by iteration.
# Half and twice: the first step of blocks between the two values takes longer.
LEAST_ITERATIVE = 15_000
# A condensation takes as long as one iterative step for so many free degrees of freedom: its
# work grows with their square, that of a step in proportion. Half: paths of twice as many
# steps iterate; twice: those of half as many are condensed. At the border both take equally
# long.
DOFS_PER_STEP = 1_500
# Contacts from which a direct step, whose work grows with their cube, takes longer than an
# iterative one. Half and twice: long paths of bodies between the two values take longer.
MANY_CONTACTS = 1_000
# Steps of an adaptive path between two stops, which is what the choice expects. Half and
# twice: as with DOFS_PER_STEP.
ADAPTIVE_STEPS = 8
# Work of an iterative load step for each degree of freedom [flop], in the unit in which the
# direct engine does 20 Gflop/s on a core. It only changes the forecast that is printed.
STEP_FLOPS = 2e5
# Where surfaces do not match: the work of an iterative step, in steps of one body on a rigid
# obstacle, for so many unknowns, and the power with which it grows; the memory beside what is
# counted, for longer Krylov spaces and pieces that the heap keeps. Half of a bolted lap joint of
# 24,459, 64,551 and 244,905 unknowns takes 278, 306 and 412 Krylov iterations a step, a block or a
# matching pair some 24. Only printed.
JOINED_SOLUTIONS, JOINED_SIZE, JOINED_GROWTH, JOINED_BYTES = 12, 65_000, 0.16, 2.2
# The factor of a cube of 10⁶ degrees of freedom [bytes], and the power with which it grows.
# Half: the factor may not fit where the forecast says so; twice: the iterative engine solves
# although a factor would fit.
FACTOR_BYTES, FACTOR_GROWTH = 29e9, 1.34

# --- Forecast of a scene (cli/run/cost_forecast.py): the runs of *Forecasts of time and memory* in
# benches/results/measured_once.md. They only change what `bipot check` and the start
# of a run print. Half and twice: the forecasts are off by as much.

# Rate of the condensation [flop/s per core]. benches/README.md has twice as much on a server
# core; small bodies and old machines have less.
FLOP_RATE = 2e10
# Products with W that the load steps of the direct engine are worth: of the first for each row of
# W, of another one, and of each where surfaces do not match; and how fast W is read [bytes/s per
# core]. Cubes and pairs take 0.09 to 0.12 for each row, then 20 to 25; half of a bolted joint with
# 1351 contacts takes 1,090 a step. With 731 it takes 2,070, twice as fast: W stays in cache.
FIRST_PRODUCTS, PRODUCTS, JOINED_PRODUCTS, BYTE_RATE = 0.1, 25, 1100, 1e10
# Matrices of the size of W, beside the factor, in a load step of the direct engine: half of bolted
# joints with 731 and 1351 contacts takes 8.9, a cube with 1369 some 6. Half: the larger joint takes
# 1.5 times what is said; twice: 0.65 of it.
COPIES_OF_W = 8
# Memory of the iterative engine for each entry of the matrices of hexahedra [bytes], from which a
# run is refused; of tetrahedra, which share more entries, more than that of K.
LEAST_BYTES = 6
# Memory of the libraries that write results, which a run imports at its end, and of results for
# each unknown [bytes].
LATER_BYTES, ARRAY_BYTES = 30e6, 150
# Memory of a rank of engine petsc [bytes]: libraries, mesh and loads for each node, and copies of
# its rows of K: K itself, what the preconditioner is made of, and the preconditioner.
PROCESS_BYTES, NODE_BYTES, COPIES_ON_RANK = 135e6, 750, 9
# Poisson's ratio from which multigrid stalls if a whole body has it. Less: bodies that take
# twice as many iterations are named too.
STALLING_POISSON = 0.499

# --- Degrees of freedom without stiffness and copies (path/springs.py): tests/python/contact/path.

# Spring, relative to the largest entry of K. A hundredth of it: statuses of slipping contacts do
# not settle; ten times as much: twice the iterations.
LOOSE_SPRING = 1e-2
# Iterations; six to sixteen are usual. It ends paths that do not settle, and changes nothing else.
SPRING_ITERATIONS = 40
# Spring of a copied displacement, relative to the diagonal of K there. A third and three times
# as much: 9 % and 67 % more Krylov iterations on half of a lap joint.
COPY_SPRING = 30.0
# Work of a step with copies relative to one without; only for the forecast that is printed.
COPY_SOLUTIONS = 3
# Least singular value of secants that is no rounding, relative to the largest. A hundred times and
# a hundredth: 3 % and 1 % more Krylov iterations.
LEAST_SECANT = 1e-6
# Largest condition of the rows of a contact by which a displacement is copied.
MOST_OBLIQUE = 1e6

# --- Stiffness with few digits (stiffness/digits.py): the tests of test_stiffness_digits.py in
# tests/python/contact/stiffness. Where nothing else is said, all of them have the same outcome
# with half and with twice the value.

# Largest stiffness_rtol: fewer digits would also spoil the elasticity. Half and twice: values
# between the two are refused or taken.
LEAST_DIGITS = 1e-3
# A support must resist by this multiple of the error of K to be recognised. Half: supports of
# half the stiffness are taken; twice: those of twice the stiffness are refused.
CLEAR_SUPPORT = 100.0
# Negative eigenvalues beyond this part of the largest are not caused by few digits.
LOST_DIGITS = 1e-5
# Upper limit of the doubt whether a body is soft or its digits are wrong, relative to the entries.
SOFTEST_BODY = 1e-4
# Unknowns of a body up to which a dense and a sparse factorisation for this doubt take seconds.
# Half: bodies between the two values have no such check; twice: it takes up to eight times as long.
DENSE_DOUBT, SPARSE_DOUBT = 3000, 20_000
# Remainder of a row in ε of the sum of the absolute values of its terms: the aim of the fit, and
# the largest that is accepted. Rounding of the entries gives 1, and the sums of the check another.
FIT_AIM, FIT_REMAINDER = 4.0, 16.0
# Factor of the terms of a row with supports.
SUPPORTED_ROWS = 8.0
# Entries of K in one block of the fit: about 60 MB. It changes memory only.
FIT_ENTRIES = 200_000
# Runs of LSQR, each from the remainder of the one before, and the iterations of each. Meshes
# with 100 cells per side need about 500.
FIT_RUNS, FIT_ITERATIONS = 4, 5000

# --- Adaptive load steps (path/step_control.py): the scenes with automatic steps.

# The default of the shortest step, as a part of the path. Half and twice: a path that fails
# fails one halving later or earlier.
SMALLEST_STEP = 1e-3

# --- Jumps over cycles of wear (wear/jumps.py): `spring` and `pad` of
# tests/python/support/worn.py over 400 cycles with rtol = 0.001. The figures are the load paths
# that are solved; as it is 116 and 307.

# A jump is at most so many times as long as the one before; the limit where the estimate of
# the error is zero. Half and twice: 116 and 307.
JUMP_GROWTH = 4.0
# The next jump aims at this part of the allowed error to the power 1/3, because the estimate
# grows with the cube of the length. Half: 194 and 306; twice: 235 and 442, because jumps are
# rejected; 1: 104 and 380.
JUMP_CAUTION = 0.8
# A jump may take one part in so many of the error that is not shared out. Half: 106 and 306;
# twice: 130 and 316.
JUMP_TAKEN = 8
# After jumps that were too short, at most so many cycles pass before another attempt. Half and
# twice: 116 and 307.
JUMP_PATIENCE = 32
# Parts of a load step at most. Half and twice: a coefficient that is half or twice as large is
# refused.
MOST_PARTS = 1024
# If halved load steps change the depth by more than this part, the message asks for shorter ones.
COARSE_CYCLE = 0.1
# Up to this number of contacts, the bound of jumps is computed from the dense matrix. Half and
# twice: the time of the bound changes by milliseconds.
DENSE_BOUND = 64
# Relative error of that bound from a sparse matrix. Half and twice: a few Lanczos steps more
# or less.
BOUND_RTOL = 0.01

# --- Derivatives (sensitivity/): the paths of tests/python/contact/sensitivity.

# Combinations of sides of the border contacts that are all tried: to see whether there are
# several answers, and to find one if the iteration does not. About a millisecond each. Half:
# one border contact less; twice: one more.
SIDES_COMPARED, SIDES_TRIED = 256, 4096
# Iterations of the active set from one start; a handful are usual.
SIDE_ITERATIONS = 100
# Openings below this part of the largest displacement or gap may be on a border: their W is
# formed too.
NEARLY_CLOSED = 1e-6
# Bytes of the compliance and of the factored systems that a result keeps for further
# derivatives. Half and twice: larger or smaller paths are linearised again each time.
KEPT_BYTES = 1 << 28
# Entries of K whose products are computed together, so that they stay in the cache.
ENTRIES_TOGETHER = 1 << 14

# --- Blocks and sizes.

# Displacements that are recovered in one pass over the factor: more right sides gain nothing.
DISPLACEMENTS_TOGETHER = 32
# Columns of W of a global problem that are solved together: W is never dense.
COLUMNS_TOGETHER = 64
# Up to this number of points, all pairs take less time than the import of a search tree.
ALL_PAIRS = 1000
# Rows of W up to which a diagnosis computes its eigenvalues; for more they take seconds.
DENSE_DIAGNOSIS = 1500

# --- Diagnosis and remarks (messages/): the failing solves of test_diagnosis.py, and the
# shipped scenes, which must have no remark. They change only what a message names.

# If one motion is softer than all others by this factor, a residual of 1e-10 says nothing
# about the others.
SOFT_MOTION = 1e8
# From this μ on, μ times the rounding error of a displacement is a large residual.
HUGE_FRICTION = 1e8
# Rows of history needed to see whether the residual falls, and the factor by which the last
# fifth of the iterations must reduce it.
HISTORY_ROWS, STILL_FALLS = 10, 0.9
# Reactions that K determines to fewer digits are not proved to be unique. Half and twice: a
# body on supports of 1e-12 of its stiffness is called unique or not.
UNDETERMINED = 1e-3
# Below this residual the statuses are probably those of a solution, and show whether there are
# several solutions.
NEAR_SOLUTION = 1e-3
# Below this, η and the violations of the law are small.
SMALL_VIOLATION = 1e-6
# Below this cosine a normal points the wrong way. A normal towards the closest point may
# differ from that of the surface.
WRONG_NORMAL = -0.5
# Single contacts with a gap above this part of the size of the model are not checked: an
# obstacle next to an edge may lie on its other side.
CLOSE_GAP = 0.05
# Mean strain above which strains are not small.
LARGE_STRAIN = 0.05
# Limit of the slip of a step over the extent of all contacts.
LONG_SLIP = 1.0
# A motion is nearly a translation if its rotation moves the contacts by less than the
# translation divided by this.
NEARLY_TRANSLATION = 2.0
