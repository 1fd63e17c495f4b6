"""Poses obey the laws of SE(3), carry covariances as sampling says, and refuse what is no pose."""

from __future__ import annotations

import copy
import math
import pickle

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from scipy.spatial.transform import Rotation

from dsr.math3d.quaternions import about_z, from_rotvec, product
from dsr.math3d.transforms import Pose, exp, interpolate, log, looking_at

coordinates = st.floats(-10.0, 10.0)
vectors = st.tuples(coordinates, coordinates, coordinates)
quaternions = (
    st.tuples(*[st.floats(-1.0, 1.0)] * 4)
    .filter(lambda q: math.hypot(*q) > 0.1)
    .map(lambda q: tuple(c / math.hypot(*q) for c in q))
)
stamps = st.floats(0.0, 2e9)
fractions = st.floats(0.0, 1.0)
roots = arrays.arrays(np.float64, (6, 6), elements=st.floats(-0.1, 0.1))
covariances = roots.map(lambda root: root @ root.T)
exact_poses = st.builds(Pose, vectors, quaternions, stamps)
uncertain_poses = st.builds(Pose, vectors, quaternions, stamps, covariances)
poses = st.one_of(exact_poses, uncertain_poses)


def assert_close(a: Pose, b: Pose, atol: float = 1e-9) -> None:
    metres, radians = a.distance(b)
    assert metres < atol
    assert radians < atol
    assert (a.covariance is None) == (b.covariance is None)
    if a.covariance is not None:
        np.testing.assert_allclose(a.covariance, b.covariance, atol=1e-7)


class TestGroup:
    @given(poses, poses, poses)
    def test_composition_is_associative(self, a: Pose, b: Pose, c: Pose) -> None:
        assert_close((a @ b) @ c, a @ (b @ c))

    @given(poses)
    def test_identity_is_neutral(self, pose: Pose) -> None:
        assert_close(Pose.identity() @ pose, pose)
        assert_close(pose @ Pose.identity(), pose)
        assert (Pose.identity() @ pose).stamp == (pose @ Pose.identity()).stamp == pose.stamp

    @given(exact_poses)
    def test_inverse_undoes(self, pose: Pose) -> None:
        assert_close(pose @ pose.inverse(), Pose.identity())
        assert_close(pose.inverse() @ pose, Pose.identity())

    @given(poses)
    def test_inverse_of_inverse_is_the_pose(self, pose: Pose) -> None:
        assert_close(pose.inverse().inverse(), pose)
        assert pose.inverse().stamp == pose.stamp

    @given(exact_poses, exact_poses)
    def test_composition_is_the_matrix_product(self, a: Pose, b: Pose) -> None:
        np.testing.assert_allclose((a @ b).matrix, a.matrix @ b.matrix, atol=1e-12)

    @given(exact_poses, exact_poses, arrays.arrays(np.float64, (5, 3), elements=coordinates))
    def test_composition_applies_the_right_one_first(self, a: Pose, b: Pose, points: np.ndarray) -> None:
        np.testing.assert_allclose((a @ b).apply(points), a.apply(b.apply(points)), atol=1e-12)

    def test_long_products_stay_rotations(self) -> None:
        step = Pose.from_rotvec((0.0, 0.0, 0.0), (0.3, -0.2, 0.1))
        product = step
        for _ in range(20_000):
            product = product @ step
        assert abs(math.hypot(*product.q) - 1.0) < 1e-12

    def test_only_poses_compose(self) -> None:
        for other in (np.eye(4), 2.0):
            with pytest.raises(TypeError):
                Pose() @ other  # type: ignore[operator]
            with pytest.raises(TypeError):
                other @ Pose()


class TestRepresentations:
    @given(exact_poses)
    def test_rotation_agrees_with_scipy(self, pose: Pose) -> None:
        theirs = Rotation.from_quat(pose.q)
        np.testing.assert_allclose(pose.rotation_matrix, theirs.as_matrix(), atol=1e-12)
        turned = Rotation.from_rotvec(np.array(pose.rotvec))  # scipy wants an array that it could write to
        np.testing.assert_allclose(turned.as_matrix(), theirs.as_matrix(), atol=1e-12)
        assert np.linalg.norm(pose.rotvec) <= math.pi + 1e-12

    @given(exact_poses)
    @example(Pose((1, 2, 3), (1, 0, 0, 0)))
    @example(Pose((1, 2, 3), (0, 1, 0, 0)))
    @example(Pose((1, 2, 3), (0, 0, 1, 0)))
    def test_matrix_and_back(self, pose: Pose) -> None:
        assert_close(Pose.from_matrix(pose.matrix, pose.stamp), pose)

    @given(exact_poses)
    @example(Pose(rotation=(0, 0, 0, -1)))
    def test_rotvec_and_back(self, pose: Pose) -> None:
        assert_close(Pose.from_rotvec(pose.t, pose.rotvec), pose)

    def test_quarter_turn_about_z_takes_x_to_y(self) -> None:
        pose = Pose.from_rotvec((0.0, 0.0, 1.0), (0.0, 0.0, math.pi / 2))
        np.testing.assert_allclose(pose.apply((1.0, 0.0, 0.0)), (0.0, 1.0, 1.0), atol=1e-15)

    @given(exact_poses, exact_poses)
    def test_distance_is_symmetric_and_angle_agrees_with_scipy(self, a: Pose, b: Pose) -> None:
        metres, radians = a.distance(b)
        assert (metres, radians) == pytest.approx(b.distance(a))
        assert metres == pytest.approx(np.linalg.norm(a.translation - b.translation))
        angle = (Rotation.from_quat(a.q).inv() * Rotation.from_quat(b.q)).magnitude()
        assert radians == pytest.approx(angle, abs=1e-7)

    @given(vectors, vectors)
    @example((1.0, -2.0, 3.0), (0.0, 0.0, 0.0))
    @example((1.0, -2.0, 3.0), (9e-4, 0.0, 0.0))
    @example((1.0, -2.0, 3.0), (1.1e-3, 0.0, 0.0))
    def test_log_undoes_exp(self, rho: tuple[float, ...], phi: tuple[float, ...]) -> None:
        assume(math.hypot(*phi) < math.pi - 1e-3)
        np.testing.assert_allclose(log(exp(rho + phi)), rho + phi, rtol=0.0, atol=1e-9)

    @given(exact_poses)
    @example(Pose((1, 2, 3), (1, 0, 0, 0)))
    def test_exp_undoes_log(self, pose: Pose) -> None:
        assert_close(exp(log(pose)), pose)

    @given(vectors, vectors, fractions)
    def test_exp_of_one_screw_adds_up(self, rho: tuple[float, ...], phi: tuple[float, ...], s: float) -> None:
        twist = np.array(rho + phi)
        assert_close(exp(s * twist) @ exp((1.0 - s) * twist), exp(twist), atol=1e-8)


class TestValues:
    @given(poses)
    def test_copies_are_equal_bit_by_bit(self, pose: Pose) -> None:
        again = Pose(pose.t, pose.q, pose.stamp, pose.cov)
        for copied in (again, copy.deepcopy(pose), pickle.loads(pickle.dumps(pose)), eval(repr(pose))):
            assert copied == pose
            assert hash(copied) == hash(pose)

    @given(exact_poses, exact_poses)
    def test_a_composed_pose_survives_a_copy_bit_by_bit(self, a: Pose, b: Pose) -> None:
        product = a @ b
        assert Pose(product.t, product.q, product.stamp) == product

    @given(exact_poses)
    def test_each_value_counts_for_equality(self, pose: Pose) -> None:
        assert pose != Pose((11.0, 0.0, 0.0), pose.q, pose.stamp)
        assert pose != pose.with_stamp(pose.stamp + 1.0)
        assert pose != pose.with_covariance(np.eye(6))
        assert pose != "pose"

    def test_is_immutable(self) -> None:
        pose = Pose(covariance=np.eye(6))
        with pytest.raises(AttributeError, match="immutable"):
            pose.t = (1.0, 0.0, 0.0)
        with pytest.raises(AttributeError, match="immutable"):
            del pose.q
        for name in ("translation", "rotation", "covariance", "matrix", "rotation_matrix", "rotvec"):
            with pytest.raises(ValueError, match="read-only"):
                getattr(pose, name)[...] = 0.0

    def test_arrays_lists_and_integers_become_plain_floats(self) -> None:
        pose = Pose(np.array([1, 2, 3], dtype=np.float32), [0, 0, 0, 1], np.float64(4.0), np.eye(6).tolist())
        assert pose == Pose((1.0, 2.0, 3.0), (0.0, 0.0, 0.0, 1.0), 4.0, tuple(np.eye(6).ravel()))
        assert {type(x) for x in (*pose.t, *pose.q, pose.stamp, *(pose.cov or ()))} == {float}

    @given(quaternions, st.floats(-9e-4, 9e-4))
    def test_rotation_slightly_off_the_unit_norm_is_normalised(self, q: tuple[float, ...], off: float) -> None:
        pose = Pose(rotation=tuple(c * (1.0 + off) for c in q))
        assert math.hypot(*pose.q) == pytest.approx(1.0, abs=1e-12)
        np.testing.assert_allclose(pose.q, q, atol=1e-12)

    @pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, "far", None])
    def test_a_value_that_is_no_finite_number_is_refused_by_name(self, bad: float) -> None:
        with pytest.raises(ValueError, match=r"translation .*expected 3"):
            Pose((0.0, bad, 0.0))
        with pytest.raises(ValueError, match="rotation"):
            Pose(rotation=(bad, 0.0, 0.0, 1.0))
        with pytest.raises(ValueError, match="stamp"):
            Pose(stamp=bad)
        with pytest.raises(ValueError, match="covariance"):
            Pose(covariance=[[bad] * 6] * 6)

    @pytest.mark.parametrize("q", [(0, 0, 0, 0), (0, 0, 0, 0.998), (0, 0, 0, 1.002), (1, 1, 1, 1), (1e200, 0, 0, 0)])
    def test_a_rotation_off_the_unit_norm_is_refused(self, q: tuple[float, ...]) -> None:
        with pytest.raises(ValueError, match="norm"):
            Pose(rotation=q)

    def test_wrong_lengths_are_refused(self) -> None:
        with pytest.raises(ValueError, match="translation"):
            Pose((0.0, 0.0))
        with pytest.raises(ValueError, match="rotation"):
            Pose(rotation=(0.0, 0.0, 1.0))
        with pytest.raises(ValueError, match=r"\(5, 5\).*expected \(6, 6\)"):
            Pose(covariance=np.eye(5))

    @given(uncertain_poses)
    def test_covariances_along_the_parents_axes(self, pose: Pose) -> None:
        """Those of the same frame turned so that its axes are the parent's."""
        place, rotation = pose.parent_covariances()
        turned = pose @ Pose((0.0, 0.0, 0.0), pose.q).inverse()
        assert turned.covariance is not None
        np.testing.assert_allclose(place, turned.covariance[:3, :3], atol=1e-9)
        np.testing.assert_allclose(rotation, turned.covariance[3:, 3:], atol=1e-9)

    def test_an_exact_pose_has_no_covariances_along_any_axes(self) -> None:
        with pytest.raises(ValueError, match="no covariance"):
            Pose.identity().parent_covariances()

    def test_what_is_no_covariance_is_refused(self) -> None:
        lopsided = np.eye(6)
        lopsided[0, 1] = 0.1
        with pytest.raises(ValueError, match="symmetric"):
            Pose(covariance=lopsided)
        with pytest.raises(ValueError, match="negative"):
            Pose(covariance=-np.eye(6))

    def test_asymmetry_by_rounding_is_evened_out(self) -> None:
        rounded = np.eye(6)
        rounded[0, 1] = 1e-8
        covariance = Pose(covariance=rounded).covariance
        assert covariance is not None
        np.testing.assert_array_equal(covariance, covariance.T)

    @pytest.mark.parametrize(
        "matrix", [np.eye(3), 2.0 * np.eye(4), np.diag([1.0, 1.0, -1.0, 1.0]), np.full((4, 4), np.nan)]
    )
    def test_what_is_no_rigid_matrix_is_refused(self, matrix: np.ndarray) -> None:
        with pytest.raises(ValueError, match="matrix"):
            Pose.from_matrix(matrix)


class TestStamps:
    @pytest.mark.parametrize(
        ("a", "b", "composed"), [(0.0, 0.0, 0.0), (0.0, 5.0, 5.0), (5.0, 0.0, 5.0), (5.0, 3.0, 3.0), (3.0, 5.0, 3.0)]
    )
    def test_the_older_moving_one_holds(self, a: float, b: float, composed: float) -> None:
        assert (Pose(stamp=a) @ Pose(stamp=b)).stamp == composed


class TestCovariance:
    """Right perturbation: T = T_mean exp(xi), xi drawn from the covariance."""

    SAMPLES = 4000

    def draw(self, rng: np.random.Generator, pose: Pose) -> list[Pose]:
        if pose.covariance is None:
            return [pose] * self.SAMPLES
        mean = pose.with_covariance(None)
        twists = rng.multivariate_normal(np.zeros(6), pose.covariance, self.SAMPLES)
        return [mean @ exp(twist) for twist in twists]

    def sampled(self, mean: Pose, samples: list[Pose]) -> np.ndarray:
        inverse = mean.with_covariance(None).inverse()
        return np.cov(np.array([log(inverse @ sample) for sample in samples]).T)

    def random_pose(self, rng: np.random.Generator, *, exact: bool = False) -> Pose:
        root = rng.normal(size=(6, 6)) * 4e-3
        covariance = None if exact else root @ root.T
        return Pose.from_rotvec(rng.normal(size=3), rng.normal(size=3), covariance=covariance)

    def assert_same(self, propagated: np.ndarray | None, sampled: np.ndarray) -> None:
        assert propagated is not None
        sigmas = np.sqrt(np.diag(propagated))
        np.testing.assert_allclose(propagated / np.outer(sigmas, sigmas), sampled / np.outer(sigmas, sigmas), atol=0.1)

    @pytest.mark.parametrize("seed", range(3))
    @pytest.mark.parametrize("exact", [(False, False), (True, False), (False, True)])
    def test_composition_agrees_with_sampling(self, seed: int, exact: tuple[bool, bool]) -> None:
        rng = np.random.default_rng(seed)
        a, b = (self.random_pose(rng, exact=e) for e in exact)
        pairs = zip(self.draw(rng, a), self.draw(rng, b), strict=True)
        self.assert_same((a @ b).covariance, self.sampled(a @ b, [x @ y for x, y in pairs]))

    @pytest.mark.parametrize("seed", range(3))
    def test_inverse_agrees_with_sampling(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        pose = self.random_pose(rng)
        samples = [sample.inverse() for sample in self.draw(rng, pose)]
        self.assert_same(pose.inverse().covariance, self.sampled(pose.inverse(), samples))

    @given(uncertain_poses, poses)
    def test_stays_symmetric_and_positive(self, a: Pose, b: Pose) -> None:
        for pose in (a @ b, b @ a, a.inverse()):
            covariance = pose.covariance
            assert covariance is not None
            np.testing.assert_array_equal(covariance, covariance.T)
            assert np.linalg.eigvalsh(covariance).min() > -1e-9 * (1.0 + covariance.max())

    def test_rounding_makes_no_variance_negative(self) -> None:
        rng = np.random.default_rng(0)
        for scale in 10.0 ** rng.integers(-6, 3, size=(500, 6, 1)):
            spread = scale * rng.normal(size=(6, 1))  # certain in five of six directions
            pose = Pose.from_rotvec(rng.normal(size=3), rng.normal(size=3), covariance=spread @ spread.T)
            again = pose.inverse().inverse().covariance
            assert again is not None and again.diagonal().min() >= 0.0

    @given(exact_poses, exact_poses)
    def test_exact_poses_stay_exact(self, a: Pose, b: Pose) -> None:
        assert (a @ b).covariance is None
        assert a.inverse().covariance is None

    def test_an_exact_parent_leaves_the_covariance_alone(self) -> None:
        covariance = np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
        parent = Pose.from_rotvec((1.0, 2.0, 3.0), (0.1, 0.2, 0.3))
        np.testing.assert_array_equal((parent @ Pose(covariance=covariance)).covariance, covariance)

    def test_a_lever_turns_angular_into_linear_uncertainty(self) -> None:
        shaky = Pose(covariance=np.diag([0.0, 0.0, 0.0, 0.0, 0.0, 0.01]))
        far = (shaky @ Pose((2.0, 0.0, 0.0))).covariance
        assert far is not None
        assert math.sqrt(far[1, 1]) == pytest.approx(2.0 * 0.1)


def test_the_yaw_of_a_rotation_is_what_is_left_without_its_tilt() -> None:
    yaw, tilt = from_rotvec((0.0, 0.0, 0.7)), from_rotvec((0.3, -0.4, 0.0))
    assert about_z(product(tilt, yaw)) == pytest.approx(yaw)
    assert about_z((1.0, 0.0, 0.0, 0.0)) == (0.0, 0.0, 0.0, 1.0)


class TestInterpolation:
    @given(poses, poses)
    def test_ends_are_the_samples(self, a: Pose, b: Pose) -> None:
        a, b = a.with_stamp(1.0), b.with_stamp(3.0)
        assert interpolate(a, b, 1.0) is a
        assert interpolate(a, b, 3.0) is b

    @given(exact_poses, exact_poses, fractions)
    def test_agrees_with_scipy_slerp(self, a: Pose, b: Pose, s: float) -> None:
        a, b = a.with_stamp(1.0), b.with_stamp(2.0)
        start, end = Rotation.from_quat(a.q), Rotation.from_quat(b.q)
        between = (start.inv() * end).as_rotvec()
        assume(np.linalg.norm(between) < math.pi - 1e-3)  # at half a turn either way is the shorter
        middle = interpolate(a, b, 1.0 + s)
        assert (Rotation.from_quat(middle.q).inv() * start * Rotation.from_rotvec(s * between)).magnitude() < 1e-6
        np.testing.assert_allclose(middle.t, (1.0 - s) * a.translation + s * b.translation, atol=1e-9)
        assert middle.stamp == 1.0 + s

    @given(exact_poses, st.tuples(*[st.floats(-1.5, 1.5)] * 3), st.integers(1, 9))
    @example(Pose(), (1e-5, 0.0, 0.0), 3)
    @example(Pose(), (5e-4, 0.0, 0.0), 3)
    @example(Pose(), (0.2, 0.0, 0.0), 3)
    def test_turns_at_constant_speed(self, a: Pose, rotvec: tuple[float, ...], tenth: int) -> None:
        a = a.with_stamp(10.0)
        b = (a @ Pose.from_rotvec((1.0, 0.0, 0.0), rotvec)).with_stamp(20.0)
        metres, radians = a.distance(interpolate(a, b, 10.0 + tenth))
        assert metres == pytest.approx(tenth / 10.0, abs=1e-9)
        assert radians == pytest.approx(math.hypot(*rotvec) * tenth / 10.0, abs=1e-9)

    @given(exact_poses, exact_poses)
    def test_takes_the_shorter_way_whatever_the_signs(self, a: Pose, b: Pose) -> None:
        a, b = a.with_stamp(1.0), b.with_stamp(2.0)
        assume(a.distance(b)[1] < math.pi - 1e-3)
        flipped = Pose(b.t, tuple(-c for c in b.q), 2.0)
        middle = interpolate(a, b, 1.5)
        assert middle.distance(interpolate(a, flipped, 1.5))[1] < 1e-7
        assert a.distance(middle)[1] == pytest.approx(0.5 * a.distance(b)[1], abs=1e-7)

    def test_covariance_is_blended(self) -> None:
        a, b = Pose(stamp=1.0, covariance=np.eye(6)), Pose(stamp=2.0, covariance=3.0 * np.eye(6))
        np.testing.assert_allclose(interpolate(a, b, 1.25).covariance, 1.5 * np.eye(6))
        np.testing.assert_allclose(interpolate(a.with_covariance(None), b, 1.25).covariance, 3.0 * np.eye(6))
        np.testing.assert_allclose(interpolate(a, b.with_covariance(None), 1.25).covariance, np.eye(6))

    @pytest.mark.parametrize("at", [0.9, 2.1, math.nan])
    def test_outside_the_samples_is_refused(self, at: float) -> None:
        with pytest.raises(ValueError, match=r"1\.0 s and 2\.0 s"):
            interpolate(Pose(stamp=1.0), Pose(stamp=2.0), at)


@pytest.mark.parametrize("target", [(0.4, 0.1, 0.0), (1.0, 2.0, -5.0), (-3.0, 2.0, 0.7)])
def test_a_camera_looks_at_its_target_and_is_upright(target: tuple[float, float, float]) -> None:
    pose = looking_at((1.0, 2.0, 0.7), target)
    assert pose.inverse().apply(target) == pytest.approx((0.0, 0.0, math.dist((1.0, 2.0, 0.7), target)))
    right, down, _ = pose.rotation_matrix.T
    assert right[2] == pytest.approx(0.0) and down[2] <= 1e-9


def test_a_camera_that_looks_straight_down_has_the_upper_side_towards_x() -> None:
    assert looking_at((0.0, 0.0, 1.0), (0.0, 0.0, 0.0)).rotation_matrix[:, 1] == pytest.approx((-1.0, 0.0, 0.0))
