# Copyright 2026 the epson_driver developers
# SPDX-License-Identifier: Apache-2.0
"""The meshes in urdf/meshes: as generated, closed, small, convex where they must be."""

import itertools

import numpy as np
import pytest
import yaml

from epson_driver.robots import load_robot_model
from epson_driver.robots.kinematics import Kinematics
from epson_driver.share import share_folder

trimesh = pytest.importorskip('trimesh')
pytest.importorskip('manifold3d')

from generate.dimensions import dimensions  # noqa: E402
from generate.meshes import (  # noqa: E402
    collision_file,
    described_models,
    description,
    sharing,
    visual_file,
)

MESHES = share_folder('urdf', 'meshes')
MODELS = described_models()
each_model = pytest.mark.parametrize('model', MODELS, ids=lambda model: model.name)

SAME = 1e-5
"""How far two geometries may differ, m: other processors round otherwise."""


def load(path):
    return trimesh.load_mesh(MESHES / path)


def described(model):
    """Return of each link its visual and its collision meshes, as links.yaml lists them."""
    links = yaml.safe_load((MESHES / model.name / 'links.yaml').read_text('utf-8'))
    return {
        name: ([load(each['mesh']) for each in link['visual']], list(map(load, link['collision'])))
        for name, link in links.items()
    }


@pytest.fixture(scope='module')
def generated():
    return {model.name: (links, homes) for model, links, homes in sharing(MODELS)}


@pytest.mark.slow
@each_model
def test_the_files_hold_what_the_generator_makes(model, generated):
    links, homes = generated[model.name]
    for name, link in links.items():
        made = {visual_file(homes[name], name, c): mesh for c, mesh in link.visual.items()}
        for i, mesh in enumerate(link.collision):
            made[collision_file(homes[name], name, i)] = mesh
        for path, mesh in made.items():
            stored = load(path)
            assert len(stored.faces) == len(mesh.faces), f'{path}: run `make generate`'
            assert stored.bounds == pytest.approx(mesh.bounds, abs=SAME), path
            assert stored.volume == pytest.approx(mesh.volume, rel=1e-3), path
            assert stored.center_mass == pytest.approx(mesh.center_mass, abs=SAME), path


@each_model
def test_links_yaml_is_what_the_generator_writes(model, generated):
    stored = (MESHES / model.name / 'links.yaml').read_text('utf-8')
    numbers = yaml.safe_load(description(*generated[model.name]))
    for name, link in yaml.safe_load(stored).items():
        expected = numbers.pop(name)
        assert link.keys() == expected.keys()
        assert link['visual'] == expected['visual']
        assert link['collision'] == expected['collision']
        for key, value in expected['inertial'].items():
            assert link['inertial'][key] == pytest.approx(value, abs=SAME)
    assert numbers == {}


def test_there_are_no_other_files_and_all_are_under_4_mb(generated):
    expected = {f'{name}/links.yaml' for name in generated}
    for links, homes in generated.values():
        for name, link in links.items():
            expected |= {visual_file(homes[name], name, colour) for colour in link.visual}
            expected |= {collision_file(homes[name], name, i) for i in range(len(link.collision))}
    files = [path for path in MESHES.rglob('*') if path.is_file()]
    assert {path.relative_to(MESHES).as_posix() for path in files} == expected
    assert sum(path.stat().st_size for path in files) < 4_000_000


@each_model
def test_every_mesh_is_closed_and_collision_meshes_are_convex_and_small(model):
    for name, (visual, collision) in described(model).items():
        for mesh in [*visual, *collision]:
            assert mesh.is_watertight, name
            assert mesh.volume > 0.0, name
        for mesh in collision:
            assert mesh.is_convex, name
            assert 12 <= len(mesh.faces) <= 68, name
        assert len(collision) <= 4, name


@each_model
def test_collision_meshes_enclose_the_visual_ones_closely(model):
    for name, (visual, collision) in described(model).items():
        for mesh in visual:
            outside = np.min([farthest_outside(mesh.vertices, part) for part in collision], axis=0)
            assert np.max(outside) < 1e-6, name
        union = trimesh.boolean.union(collision, engine='manifold')
        hull = trimesh.convex.convex_hull(np.concatenate([mesh.vertices for mesh in visual]))
        assert union.volume < 1.08 * hull.volume, name
        whole = trimesh.boolean.union(visual, engine='manifold')
        assert union.volume < 1.4 * whole.volume, name
        assert union.bounds == pytest.approx(whole.bounds, abs=0.0005), name


def farthest_outside(points, convex):
    """Return by how much each point lies outside of the faces of a convex mesh, shape (n,), m."""
    distances = points @ convex.face_normals.T
    return np.max(distances - np.sum(convex.triangles[:, 0] * convex.face_normals, axis=1), axis=1)


@each_model
def test_neighbours_overlap_where_the_joint_is(model):
    """No gap is seen at a joint: the solids of both links have space in common there."""
    frames = [np.eye(4), *Kinematics(model).link_frames(np.zeros(len(model.joint_names)))]
    solids = []
    for frame, (visual, _) in zip(frames, described(model).values(), strict=True):
        solid = trimesh.boolean.union(visual, engine='manifold')
        solids.append(solid.apply_transform(frame))
    for i, (below, above) in enumerate(itertools.pairwise(solids)):
        common = trimesh.boolean.intersection([below, above], engine='manifold')
        assert common.volume > 1e-8, f'joint_{i + 1}'
        axis, place = model.chain.axes[i], frames[i + 1][:3, 3]
        apart = np.cross(common.center_mass - place, axis)  # the overlap lies around the axis
        assert np.linalg.norm(apart) < 0.35 * np.max(above.extents), f'joint_{i + 1}'


@each_model
def test_the_collision_meshes_are_free_over_each_joints_range(model):
    """Other links touch at zero in none of them, nor while one joint of the wrist or arm turns."""
    pytest.importorskip('pinocchio')
    from benchmark.collision import Checker

    checker = Checker(model, convex=True)
    limits = model.limits
    count = len(model.joint_names)
    assert not checker.touches(np.zeros(count))
    assert checker.distance(np.zeros(count)) > 0.005
    for joint in range(count):
        if count == 6 and joint == 1:  # it alone brings the forearm down to the base
            continue
        for value in np.linspace(limits.position_min[joint], limits.position_max[joint], 25):
            position = np.zeros(count)
            position[joint] = value
            assert not checker.touches(position), (model.joint_names[joint], value)


def test_the_c3_has_the_size_of_the_real_one():
    """Bounding boxes of the ROS 1 support package's meshes, mm, within a few millimetres."""
    real = {
        'base_link': ((-199.5, -90, 0), (90, 90, 196.5)),
        'link_1': ((-82, -99, -8.5), (158, 99, 181.6)),
        'link_2': ((-59, -99, -59), (59, 99, 299)),
        'link_4': ((63, -55.5, -46.4), (281, 55.5, 58.5)),
        'link_6': ((-4.2, -30, -30), (5, 30, 30)),
    }
    links = described(MODELS[0])
    assert MODELS[0].name == 'c3_a601s'
    for name, bounds in real.items():
        low = np.min([mesh.bounds[0] for mesh in links[name][0]], axis=0)
        high = np.max([mesh.bounds[1] for mesh in links[name][0]], axis=0)
        assert np.array([low, high]) * 1e3 == pytest.approx(np.array(bounds), abs=5.0), name


@pytest.mark.parametrize('name', ['gx4_c251s', 'gx8_c652s', 'rs4_c351s', 'rs6_c552s'])
def test_the_shaft_of_a_scara_stays_in_its_housing_over_the_whole_stroke(name):
    model = load_robot_model(name)
    links, arm = described(model), Kinematics(model)
    housing = trimesh.boolean.union(links['link_2'][0], engine='manifold')
    for height in np.linspace(model.limits.position_min[2], model.limits.position_max[2], 5):
        frames = arm.link_frames(np.array([0.0, 0.0, height, 0.0]))
        shaft = trimesh.boolean.union(links['link_3'][0], engine='manifold')
        shaft.apply_transform(np.linalg.inv(frames[1]) @ frames[2])
        top = shaft.bounds[1, 2]
        assert housing.bounds[0, 2] + 0.01 < top < housing.bounds[1, 2], height


@pytest.mark.parametrize(('joint', 'axis', 'value'), [(3, 1, 0.05), (0, 2, -0.1965)])
def test_a_chain_of_another_build_is_refused(joint, axis, value):
    """An arm with an offset to the side, one that hangs from the ceiling."""
    model = load_robot_model('c3_a601s')
    model.chain.origins[joint, axis] = value
    with pytest.raises(ValueError, match='no mesh can be made'):
        dimensions(model)
