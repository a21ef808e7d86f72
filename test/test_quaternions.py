"""Quaternions of arrays, against scipy."""

import numpy as np
from scipy.spatial.transform import Rotation

from parallel_robot_model.mechanisms import spatial


def rotations():
    vectors = np.random.default_rng(1).uniform(-1.8, 1.8, (200, 3))
    return np.vstack([vectors, np.zeros(3), [1e-12, 0.0, 0.0], [np.pi, 0.0, 0.0], [0.0, 3.0, 0.0]])


def test_of_vectors_and_back():
    vectors = rotations()
    found = spatial.quaternions_of_vectors(vectors)
    np.testing.assert_allclose(found, Rotation.from_rotvec(vectors).as_quat(), 0.0, 1e-15)
    back = Rotation.from_rotvec(spatial.vectors_of_quaternions(-3.0 * found)).inv()
    assert (back * Rotation.from_rotvec(vectors)).magnitude().max() < 1e-14


def test_of_matrices_and_products():
    for one, other in zip(rotations(), rotations()[::-1], strict=True):
        a, b = Rotation.from_rotvec(one), Rotation.from_rotvec(other)
        p, q = (spatial.quaternion_of_matrix(each.as_matrix()) for each in (a, b))
        turned = Rotation.from_quat(spatial.quaternion_product(p, q)[0])
        assert (turned.inv() * (a * b)).magnitude() < 1e-14
