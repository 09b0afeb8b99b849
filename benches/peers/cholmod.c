/* CHOLMOD's supernodal factorisation of K with the contact unknowns last: S = L_cc L_ccᵀ.
 *
 *     cholmod FILE REPEAT
 *
 * FILE holds, as native 64-bit integers and doubles: n, m, d, nnz; column pointers
 * (n + 1), row indices and values of the lower triangle; the last m unknowns are the
 * contact's, and d unknowns make a node. The interior is ordered by METIS twice, unknown
 * by unknown and node by node, and the order with fewer operations is kept. Prints one
 * JSON line; S is written to FILE.s, column-major, in the order of the contact unknowns.
 * Seconds are of the numeric phase alone, the smallest of REPEAT. Threads are BLAS's own,
 * OPENBLAS_NUM_THREADS.
 */
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <cholmod.h>

typedef SuiteSparse_long Int;

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void fail(const char *what) {
    fprintf(stderr, "%s\n", what);
    exit(1);
}

static void take(void *to, size_t size, size_t count, FILE *file) {
    if (fread(to, size, count, file) != count) fail("the file is too short");
}

/* METIS on the pattern of the interior, d unknowns taken as one; order gets n entries. */
static void order_interior(cholmod_sparse *A, Int m, Int d, Int *order,
                           cholmod_common *c) {
    Int n = (Int)A->nrow, inner = n - m, nodes = inner / d;
    Int *p = A->p, *i = A->i;
    Int *seen = malloc((size_t)nodes * sizeof(Int));
    if (seen == NULL) fail("no memory");
    cholmod_sparse *G = cholmod_l_allocate_sparse((size_t)nodes, (size_t)nodes,
        (size_t)p[n], 1, 1, -1, CHOLMOD_PATTERN, c);
    if (G == NULL) fail("no memory");
    Int *gp = G->p, *gi = G->i, count = 0;
    memset(seen, 0xff, (size_t)nodes * sizeof(Int));
    for (Int node = 0; node < nodes; node++) {
        gp[node] = count;
        for (Int col = d * node; col < d * node + d; col++)
            for (Int at = p[col]; at < p[col + 1]; at++) {
                Int row = i[at] / d;
                if (i[at] < inner && row != node && seen[row] != node) {
                    seen[row] = node;
                    gi[count++] = row;
                }
            }
    }
    gp[nodes] = count;
    Int *perm = malloc((size_t)nodes * sizeof(Int));
    if (perm == NULL) fail("no memory");
    G->sorted = 0;
    if (!cholmod_l_sort(G, c)) fail("sort");
    if (!cholmod_l_metis(G, NULL, 0, 1, perm, c)) fail("METIS");
    for (Int k = 0; k < nodes; k++)
        for (Int a = 0; a < d; a++) order[d * k + a] = d * perm[k] + a;
    for (Int k = inner; k < n; k++) order[k] = k;
    free(perm);
    free(seen);
    cholmod_l_free_sparse(&G, c);
}

static cholmod_factor *analyse(cholmod_sparse *A, Int m, Int d, double *seconds,
                               cholmod_common *c) {
    Int *order = malloc(A->nrow * sizeof(Int));
    if (order == NULL) fail("no memory");
    double begin = now();
    order_interior(A, m, d, order, c);
    c->nmethods = 1;
    c->method[0].ordering = CHOLMOD_GIVEN;
    c->postorder = 1;
    c->supernodal = CHOLMOD_SUPERNODAL;
    c->final_ll = 1;
    cholmod_factor *L = cholmod_l_analyze_p(A, order, NULL, 0, c);
    *seconds = now() - begin;
    free(order);
    if (L == NULL) fail("analysis");
    return L;
}

/* Entry (row, col), row >= col, of L in its own order; zero outside its pattern. */
static void write_schur(cholmod_factor *L, Int m, const char *path) {
    Int n = (Int)L->n, first = n - m;
    double *block = calloc((size_t)(m * m), sizeof(double));
    double *schur = calloc((size_t)(m * m), sizeof(double));
    if (block == NULL || schur == NULL) fail("no memory");
    Int *super = L->super, *pi = L->pi, *px = L->px, *s = L->s;
    double *x = L->x;
    for (Int node = 0; node < (Int)L->nsuper; node++)
        for (Int col = super[node]; col < super[node + 1]; col++) {
            if (col < first) continue;
            Int rows = pi[node + 1] - pi[node];
            for (Int k = col - super[node]; k < rows; k++) {
                double value = x[px[node] + (col - super[node]) * rows + k];
                block[(s[pi[node] + k] - first) + (col - first) * m] = value;
            }
        }
    Int *perm = L->Perm;
    for (Int k = first; k < n; k++)
        if (perm[k] < first) fail("the contact block did not stay last");
    /* Down contiguous columns, a few at a time: this is not what is measured, and row by
       row it took ten times longer than what is. */
    double *product = calloc((size_t)(m * m), sizeof(double));
    if (product == NULL) fail("no memory");
    for (Int start = 0; start < m; start += 16) {
        Int end = start + 16 < m ? start + 16 : m;
        for (Int k = 0; k < end; k++)
            for (Int b = start > k ? start : k; b < end; b++) {
                double factor = block[b + k * m];
                for (Int a = b; a < m; a++) product[a + b * m] += factor * block[a + k * m];
            }
    }
    for (Int a = 0; a < m; a++)
        for (Int b = 0; b <= a; b++) {
            Int i = perm[first + a] - first, j = perm[first + b] - first;
            schur[i + j * m] = schur[j + i * m] = product[a + b * m];
        }
    free(product);
    FILE *file = fopen(path, "wb");
    if (file == NULL || fwrite(schur, sizeof(double), (size_t)(m * m), file) != (size_t)(m * m))
        fail("cannot write S");
    fclose(file);
    free(block);
    free(schur);
}

int main(int argc, char **argv) {
    if (argc != 3) fail("usage: cholmod FILE REPEAT");
    int repeat = atoi(argv[2]);
    FILE *file = fopen(argv[1], "rb");
    if (file == NULL) fail("no such file");
    int64_t head[4];
    take(head, sizeof(int64_t), 4, file);
    Int n = head[0], m = head[1], d = head[2], nnz = head[3];
    cholmod_common common, *c = &common;
    cholmod_l_start(c);
    cholmod_sparse *A = cholmod_l_allocate_sparse((size_t)n, (size_t)n, (size_t)nnz, 1,
        1, -1, CHOLMOD_REAL, c);
    if (A == NULL) fail("no memory");
    take(A->p, sizeof(int64_t), (size_t)n + 1, file);
    take(A->i, sizeof(int64_t), (size_t)nnz, file);
    take(A->x, sizeof(double), (size_t)nnz, file);
    fclose(file);

    double order[2], flops[2], fill;
    cholmod_factor *L = analyse(A, m, 1, &order[0], c);
    flops[0] = c->fl;
    fill = c->lnz;
    cholmod_factor *other = analyse(A, m, d, &order[1], c);
    flops[1] = c->fl;
    int by_node = flops[1] < flops[0];
    cholmod_l_free_factor(by_node ? &L : &other, c);
    if (by_node) {
        L = other;
        fill = c->lnz;
    }
    double best = INFINITY;
    for (int k = 0; k < repeat; k++) {
        double begin = now();
        if (!cholmod_l_factorize(A, L, c) || c->status != CHOLMOD_OK) fail("factor");
        double seconds = now() - begin;
        if (seconds < best) best = seconds;
    }
    char path[4096];
    snprintf(path, sizeof path, "%s.s", argv[1]);
    write_schur(L, m, path);
    printf("{\"numeric\": %.6g, \"analyse\": %.6g, \"flops\": %.6g, \"nnz\": %.6g, "
           "\"ordering\": \"METIS %s\", \"version\": \"%d.%d.%d\"}\n",
           best, order[by_node], flops[by_node], fill,
           by_node ? "by node" : "by unknown", CHOLMOD_MAIN_VERSION,
           CHOLMOD_SUB_VERSION, CHOLMOD_SUBSUB_VERSION);
    cholmod_l_free_factor(&L, c);
    cholmod_l_free_sparse(&A, c);
    cholmod_l_finish(c);
    return 0;
}
