import numpy as np
import pytest
from scipy.sparse import csc_array, random_array

from driver.dic.patterns import lower_union, spread, summed_dense, summed_sparse


def test_packed_blocks_add_up_to_the_same_dense_and_sparse_matrix() -> None:
    rng = np.random.default_rng(0)
    n, k = 17, 4
    dofs = np.array([rng.permutation(n)[:k] for _ in range(12)])
    blocks = rng.normal(size=(12, k * (k + 1) // 2))
    expected = np.zeros((n, n))
    i, j = np.tril_indices(k)
    for block, where in zip(blocks, dofs, strict=True):
        full = np.zeros((k, k))
        full[i, j] = full[j, i] = block
        expected[np.ix_(where, where)] += full
    assert summed_dense(blocks, dofs, n) == pytest.approx(expected, abs=1e-14)
    sparse = csc_array(summed_sparse(blocks, dofs, n), shape=(n, n))
    assert sparse.toarray() == pytest.approx(expected, abs=1e-14)
    assert sparse.nnz == np.count_nonzero(expected)
    sparse.has_sorted_indices = False
    again = sparse.indices.copy()
    sparse.sort_indices()
    assert np.array_equal(again, sparse.indices)


def test_matrices_keep_their_lower_triangles_on_the_common_pattern() -> None:
    n = 20
    matrices = []
    for seed in (1, 2):
        a = random_array((n, n), density=0.1, rng=np.random.default_rng(seed))
        a = csc_array(a + a.T)
        a.sort_indices()
        matrices.append(a)
    arrays = [(a.indptr.astype(np.int64), a.indices.astype(np.int64), a.data) for a in matrices]
    indptr, rows = lower_union(*arrays[0][:2], *arrays[1][:2])
    present = np.eye(n) + sum((np.tril(a.toarray()) != 0) for a in matrices)
    assert len(rows) == np.count_nonzero(present)
    for matrix, array in zip(matrices, arrays, strict=True):
        values = spread(indptr, rows, *array)
        found = csc_array((values, rows, indptr), shape=(n, n)).toarray()
        assert np.array_equal(found, np.tril(matrix.toarray()))
