"""Names that vulture finds no use of, and who uses each: ``make lint`` fails on every other."""

# Called by name, by the library they are for.
_.model_config  # pydantic
_.connection_made, _.data_received, _.datagram_received, _.error_received, _.connection_lost  # asyncio
_.log_message  # http.server
_.StartDoctypeDeclHandler, _.StartElementHandler, _.EndElementHandler, _.CharacterDataHandler  # expat
_.collect  # prometheus_client
_.handle_starttag  # html.parser
_.on_config, _.on_files, _.on_page_markdown, _.on_post_build, _.nav  # mkdocs
_._from, _._workdir, _._copy, _._env, _._user, _._healthcheck, _._stopsignal, _._entrypoint, _._cmd  # getattr

_.results, _.export  # typer

# For those who call from Python, and notebooks, which look for the last by its name.
_.success, _.true_path, _._repr_png_
__getattr__  # of a module, by Python

# Loaded by the place that is told of them.
_.EncounterRunner, _.FlightRunner, _.driven, _.flown, _.AnytimeRunner

# Asked by OMPL.
_.checkMotion, _.motionCost, _.stateCost

# Read by the library that the object belongs to.
_.srcSystem, _.robust_parsing, _.secret_key, _.timestamp, _.sign_outgoing  # pymavlink
_.debug_lvl  # jsbsim

# Of the simulator, for tests.
_.displace, _.energy_used_wh
recorded_from_text, ReplayedReports

# Written to recordings as a whole data class, and read from there by their keys.
_.ended_s, _.waypoints_enu_m

# Fields of what a message says, of which nobody has needed this one yet.
_.height_above_home_m

# Members of enums that are met on the wire, or made by their numbers.
from companion.types.mavlink_enums import CommandResult, EmitterType, MessageId, MissionResult, VehicleType
from companion.types.mavlink_enums import LandedState, ParameterType, Severity

_ = [*CommandResult, *EmitterType, *LandedState, *MessageId, *MissionResult, *ParameterType, *Severity]
_ = [*VehicleType]
_.ON_GROUND
_.TEMPORARILY_REJECTED, _.CANCELLED
_.EMERGENCY_SURFACE, _.SERVICE_SURFACE, _.POINT_OBSTACLE
_.MISSION_SET_CURRENT, _.MISSION_ITEM_REACHED, _.COMMAND_LONG, _.COMMAND_ACK
_.INVALID, _.INVALID_PARAM2, _.INVALID_PARAM3, _.INVALID_PARAM4
_.INT32
_.EMERGENCY, _.ALERT, _.CRITICAL, _.NOTICE, _.DEBUG
_.VTOL_DUOROTOR, _.VTOL_QUADROTOR, _.VTOL_TILTROTOR
_.VTOL_RESERVED2, _.VTOL_RESERVED3, _.VTOL_RESERVED4, _.VTOL_RESERVED5

# What the campaigns of tests/torture and the soak inject, and how they judge it.
_.random_schedule, _.OtherUploader, _.amount
_.REBOOT, _.UPLOADER, _.DISK_FULL, _.CLOCK_JUMP, _.KILL

# Told to the tests alone: how often something happened that leaves no other trace.
_.dropped_bytes, _.connections, _.num_broken, _.is_accepted, _.num_dropped
_.use_signing, _.trim_elevator_rad, _.banks_rad

# The measures of Table 2 of the paper, for the campaign that will fly them.
_.pursuit_measures, _.estimated_share, _.first_pursued_share, _.num_reachable

# Of Enum's own protocol; and the value of a form that is neither of the two that code asks for.
_._value_, _.FORM_LITERAL
_.__call__  # of a Protocol

# What numba calls or reads when a kernel is compiled.
_.add_llvm_module, _._optimize_final_module, _._finalize_final_module, _._finalized, _._shared_module
_.linkage, _.unique_id, _.lifted, _.lifted_from, _.error_model
_.no_cfunc_wrapper, _.no_compile, _.no_cpython_wrapper, _.enable_looplift, _.enable_pyobject
_.get_call_type, _.get_call_signatures, _.get_impl_key, _.generic_resolve
_._StructModel, _._StructAttributes, _._type_of_kernel, _._constant_kernel, _._get_field, _._set_item
_._type_of_floats, _._type_of_ints, _._type_of_table, _._make_local

# Columns of docs/pilot-messages.md, which tests/docs writes.
_.cause, _.action

# When a placed track passes, for its tests.
_.meets_s

# What a service asks of a team, which only the tests do yet; and columns of the rows of sim/team.
_.members_deviating, _.members_in_conflict, _.PAYLOAD_TYPE
_.shared, _.flight_s, _.bytes_s_max, _.counted_lost

# What http.server reads and calls; and a function that the editor finds by its place.
_.daemon_threads, _.request_queue_size, _.handle_error, _.do_GET, _.do_POST, _.close_connection, _.timeout
watched
