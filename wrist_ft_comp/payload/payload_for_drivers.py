"""The commands that tell drivers and planners their payload."""

from wrist_ft_comp.payload.weight import Payload


def driver_calls(payload: Payload) -> dict[str, str]:
    """
    Write a payload as others take it, by their name; docs/drivers.md has the sources.

    The centre of mass is in the wrench's frame: right for UR and xArm where that is the flange's.
    """
    mass = f'{payload.mass_kg:.4g}'
    x, y, z = (f'{coordinate_m + 0.0:.4f}' for coordinate_m in payload.center_m)
    in_mm = ', '.join(f'{1e3 * coordinate_m + 0.0:.1f}' for coordinate_m in payload.center_m)
    return {
        'Universal Robots': (
            'ros2 service call /io_and_status_controller/set_payload ur_msgs/srv/SetPayload '
            f"'{{mass: {mass}, center_of_gravity: {{x: {x}, y: {y}, z: {z}}}}}'"
        ),
        # Six offsets follow mass and centre: the tare stays with the compensator.
        'xArm': (
            'ros2 service call /xarm/ft_sensor_cali_load xarm_msgs/srv/FtCaliLoad '
            f"'{{datas: [{mass}, {in_mm}, 0, 0, 0, 0, 0, 0]}}'"
        ),
        'URDF': (
            f'<inertial><origin xyz="{x} {y} {z}"/><mass value="{mass}"/><inertia ixx="0" ixy="0" '
            'ixz="0" iyy="0" iyz="0" izz="0"/></inertial> <!-- inertia is not identified -->'
        ),
        'MoveIt': f'moveit_msgs/AttachedCollisionObject, weight: {mass}',
    }


def driver_lines(payload: Payload) -> list[str]:
    """List the calls for people, below a line that says what they are."""
    calls = driver_calls(payload).items()
    return ['The same for drivers and planners:', *(f'  {taker}: {call}' for taker, call in calls)]
