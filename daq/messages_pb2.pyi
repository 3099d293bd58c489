from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class Severity(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    INFO: _ClassVar[Severity]
    WARNING: _ClassVar[Severity]
    ALARM: _ClassVar[Severity]
INFO: Severity
WARNING: Severity
ALARM: Severity

class Channel(_message.Message):
    __slots__ = ("name", "unit", "samples")
    NAME_FIELD_NUMBER: _ClassVar[int]
    UNIT_FIELD_NUMBER: _ClassVar[int]
    SAMPLES_FIELD_NUMBER: _ClassVar[int]
    name: str
    unit: str
    samples: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, name: _Optional[str] = ..., unit: _Optional[str] = ..., samples: _Optional[_Iterable[float]] = ...) -> None: ...

class Block(_message.Message):
    __slots__ = ("timestamp", "run", "first_sample", "rate", "status", "channels")
    TIMESTAMP_FIELD_NUMBER: _ClassVar[int]
    RUN_FIELD_NUMBER: _ClassVar[int]
    FIRST_SAMPLE_FIELD_NUMBER: _ClassVar[int]
    RATE_FIELD_NUMBER: _ClassVar[int]
    STATUS_FIELD_NUMBER: _ClassVar[int]
    CHANNELS_FIELD_NUMBER: _ClassVar[int]
    timestamp: float
    run: str
    first_sample: int
    rate: float
    status: int
    channels: _containers.RepeatedCompositeFieldContainer[Channel]
    def __init__(self, timestamp: _Optional[float] = ..., run: _Optional[str] = ..., first_sample: _Optional[int] = ..., rate: _Optional[float] = ..., status: _Optional[int] = ..., channels: _Optional[_Iterable[_Union[Channel, _Mapping]]] = ...) -> None: ...

class Estimate(_message.Message):
    __slots__ = ("timestamp", "run", "first_sample", "rate", "status", "channels", "stride")
    TIMESTAMP_FIELD_NUMBER: _ClassVar[int]
    RUN_FIELD_NUMBER: _ClassVar[int]
    FIRST_SAMPLE_FIELD_NUMBER: _ClassVar[int]
    RATE_FIELD_NUMBER: _ClassVar[int]
    STATUS_FIELD_NUMBER: _ClassVar[int]
    CHANNELS_FIELD_NUMBER: _ClassVar[int]
    STRIDE_FIELD_NUMBER: _ClassVar[int]
    timestamp: float
    run: str
    first_sample: int
    rate: float
    status: int
    channels: _containers.RepeatedCompositeFieldContainer[Channel]
    stride: int
    def __init__(self, timestamp: _Optional[float] = ..., run: _Optional[str] = ..., first_sample: _Optional[int] = ..., rate: _Optional[float] = ..., status: _Optional[int] = ..., channels: _Optional[_Iterable[_Union[Channel, _Mapping]]] = ..., stride: _Optional[int] = ...) -> None: ...

class Smoothed(_message.Message):
    __slots__ = ("timestamp", "run", "first_sample", "rate", "status", "channels", "stride")
    TIMESTAMP_FIELD_NUMBER: _ClassVar[int]
    RUN_FIELD_NUMBER: _ClassVar[int]
    FIRST_SAMPLE_FIELD_NUMBER: _ClassVar[int]
    RATE_FIELD_NUMBER: _ClassVar[int]
    STATUS_FIELD_NUMBER: _ClassVar[int]
    CHANNELS_FIELD_NUMBER: _ClassVar[int]
    STRIDE_FIELD_NUMBER: _ClassVar[int]
    timestamp: float
    run: str
    first_sample: int
    rate: float
    status: int
    channels: _containers.RepeatedCompositeFieldContainer[Channel]
    stride: int
    def __init__(self, timestamp: _Optional[float] = ..., run: _Optional[str] = ..., first_sample: _Optional[int] = ..., rate: _Optional[float] = ..., status: _Optional[int] = ..., channels: _Optional[_Iterable[_Union[Channel, _Mapping]]] = ..., stride: _Optional[int] = ...) -> None: ...

class Truth(_message.Message):
    __slots__ = ("timestamp", "run", "first_sample", "rate", "status", "channels", "stride")
    TIMESTAMP_FIELD_NUMBER: _ClassVar[int]
    RUN_FIELD_NUMBER: _ClassVar[int]
    FIRST_SAMPLE_FIELD_NUMBER: _ClassVar[int]
    RATE_FIELD_NUMBER: _ClassVar[int]
    STATUS_FIELD_NUMBER: _ClassVar[int]
    CHANNELS_FIELD_NUMBER: _ClassVar[int]
    STRIDE_FIELD_NUMBER: _ClassVar[int]
    timestamp: float
    run: str
    first_sample: int
    rate: float
    status: int
    channels: _containers.RepeatedCompositeFieldContainer[Channel]
    stride: int
    def __init__(self, timestamp: _Optional[float] = ..., run: _Optional[str] = ..., first_sample: _Optional[int] = ..., rate: _Optional[float] = ..., status: _Optional[int] = ..., channels: _Optional[_Iterable[_Union[Channel, _Mapping]]] = ..., stride: _Optional[int] = ...) -> None: ...

class Event(_message.Message):
    __slots__ = ("timestamp", "run", "sample", "sequence", "severity", "source", "kind", "text", "details")
    class DetailsEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: str
        def __init__(self, key: _Optional[str] = ..., value: _Optional[str] = ...) -> None: ...
    TIMESTAMP_FIELD_NUMBER: _ClassVar[int]
    RUN_FIELD_NUMBER: _ClassVar[int]
    SAMPLE_FIELD_NUMBER: _ClassVar[int]
    SEQUENCE_FIELD_NUMBER: _ClassVar[int]
    SEVERITY_FIELD_NUMBER: _ClassVar[int]
    SOURCE_FIELD_NUMBER: _ClassVar[int]
    KIND_FIELD_NUMBER: _ClassVar[int]
    TEXT_FIELD_NUMBER: _ClassVar[int]
    DETAILS_FIELD_NUMBER: _ClassVar[int]
    timestamp: float
    run: str
    sample: int
    sequence: int
    severity: Severity
    source: str
    kind: str
    text: str
    details: _containers.ScalarMap[str, str]
    def __init__(self, timestamp: _Optional[float] = ..., run: _Optional[str] = ..., sample: _Optional[int] = ..., sequence: _Optional[int] = ..., severity: _Optional[_Union[Severity, str]] = ..., source: _Optional[str] = ..., kind: _Optional[str] = ..., text: _Optional[str] = ..., details: _Optional[_Mapping[str, str]] = ...) -> None: ...

class ChannelSummary(_message.Message):
    __slots__ = ("timestamp", "run", "first_sample", "n_samples", "name", "unit", "mean", "minimum", "maximum", "rms")
    TIMESTAMP_FIELD_NUMBER: _ClassVar[int]
    RUN_FIELD_NUMBER: _ClassVar[int]
    FIRST_SAMPLE_FIELD_NUMBER: _ClassVar[int]
    N_SAMPLES_FIELD_NUMBER: _ClassVar[int]
    NAME_FIELD_NUMBER: _ClassVar[int]
    UNIT_FIELD_NUMBER: _ClassVar[int]
    MEAN_FIELD_NUMBER: _ClassVar[int]
    MINIMUM_FIELD_NUMBER: _ClassVar[int]
    MAXIMUM_FIELD_NUMBER: _ClassVar[int]
    RMS_FIELD_NUMBER: _ClassVar[int]
    timestamp: float
    run: str
    first_sample: int
    n_samples: int
    name: str
    unit: str
    mean: float
    minimum: float
    maximum: float
    rms: float
    def __init__(self, timestamp: _Optional[float] = ..., run: _Optional[str] = ..., first_sample: _Optional[int] = ..., n_samples: _Optional[int] = ..., name: _Optional[str] = ..., unit: _Optional[str] = ..., mean: _Optional[float] = ..., minimum: _Optional[float] = ..., maximum: _Optional[float] = ..., rms: _Optional[float] = ...) -> None: ...

class Summary(_message.Message):
    __slots__ = ("timestamp", "run", "first_sample", "n_samples", "speed_hz", "radius_maximum", "force_maximum")
    TIMESTAMP_FIELD_NUMBER: _ClassVar[int]
    RUN_FIELD_NUMBER: _ClassVar[int]
    FIRST_SAMPLE_FIELD_NUMBER: _ClassVar[int]
    N_SAMPLES_FIELD_NUMBER: _ClassVar[int]
    SPEED_HZ_FIELD_NUMBER: _ClassVar[int]
    RADIUS_MAXIMUM_FIELD_NUMBER: _ClassVar[int]
    FORCE_MAXIMUM_FIELD_NUMBER: _ClassVar[int]
    timestamp: float
    run: str
    first_sample: int
    n_samples: int
    speed_hz: float
    radius_maximum: float
    force_maximum: float
    def __init__(self, timestamp: _Optional[float] = ..., run: _Optional[str] = ..., first_sample: _Optional[int] = ..., n_samples: _Optional[int] = ..., speed_hz: _Optional[float] = ..., radius_maximum: _Optional[float] = ..., force_maximum: _Optional[float] = ...) -> None: ...

class Parameter(_message.Message):
    __slots__ = ("name", "unit", "value", "sigma", "told", "key")
    NAME_FIELD_NUMBER: _ClassVar[int]
    UNIT_FIELD_NUMBER: _ClassVar[int]
    VALUE_FIELD_NUMBER: _ClassVar[int]
    SIGMA_FIELD_NUMBER: _ClassVar[int]
    TOLD_FIELD_NUMBER: _ClassVar[int]
    KEY_FIELD_NUMBER: _ClassVar[int]
    name: str
    unit: str
    value: float
    sigma: float
    told: bool
    key: str
    def __init__(self, name: _Optional[str] = ..., unit: _Optional[str] = ..., value: _Optional[float] = ..., sigma: _Optional[float] = ..., told: _Optional[bool] = ..., key: _Optional[str] = ...) -> None: ...

class TwinSummary(_message.Message):
    __slots__ = ("timestamp", "run", "first_sample", "n_samples", "speed_hz", "amplitude_1x", "phase_1x", "contact_force_maximum", "orbit_maximum", "regime", "valid", "residual_rms", "impacts", "parameters", "not_told", "regime_confidence")
    TIMESTAMP_FIELD_NUMBER: _ClassVar[int]
    RUN_FIELD_NUMBER: _ClassVar[int]
    FIRST_SAMPLE_FIELD_NUMBER: _ClassVar[int]
    N_SAMPLES_FIELD_NUMBER: _ClassVar[int]
    SPEED_HZ_FIELD_NUMBER: _ClassVar[int]
    AMPLITUDE_1X_FIELD_NUMBER: _ClassVar[int]
    PHASE_1X_FIELD_NUMBER: _ClassVar[int]
    CONTACT_FORCE_MAXIMUM_FIELD_NUMBER: _ClassVar[int]
    ORBIT_MAXIMUM_FIELD_NUMBER: _ClassVar[int]
    REGIME_FIELD_NUMBER: _ClassVar[int]
    VALID_FIELD_NUMBER: _ClassVar[int]
    RESIDUAL_RMS_FIELD_NUMBER: _ClassVar[int]
    IMPACTS_FIELD_NUMBER: _ClassVar[int]
    PARAMETERS_FIELD_NUMBER: _ClassVar[int]
    NOT_TOLD_FIELD_NUMBER: _ClassVar[int]
    REGIME_CONFIDENCE_FIELD_NUMBER: _ClassVar[int]
    timestamp: float
    run: str
    first_sample: int
    n_samples: int
    speed_hz: float
    amplitude_1x: float
    phase_1x: float
    contact_force_maximum: float
    orbit_maximum: float
    regime: str
    valid: bool
    residual_rms: float
    impacts: int
    parameters: _containers.RepeatedCompositeFieldContainer[Parameter]
    not_told: _containers.RepeatedScalarFieldContainer[str]
    regime_confidence: float
    def __init__(self, timestamp: _Optional[float] = ..., run: _Optional[str] = ..., first_sample: _Optional[int] = ..., n_samples: _Optional[int] = ..., speed_hz: _Optional[float] = ..., amplitude_1x: _Optional[float] = ..., phase_1x: _Optional[float] = ..., contact_force_maximum: _Optional[float] = ..., orbit_maximum: _Optional[float] = ..., regime: _Optional[str] = ..., valid: _Optional[bool] = ..., residual_rms: _Optional[float] = ..., impacts: _Optional[int] = ..., parameters: _Optional[_Iterable[_Union[Parameter, _Mapping]]] = ..., not_told: _Optional[_Iterable[str]] = ..., regime_confidence: _Optional[float] = ...) -> None: ...

class Status(_message.Message):
    __slots__ = ("timestamp", "run", "sample", "process", "monotonic_ns", "utc_ns", "state", "lease_holder", "first_out", "backend", "samples", "lost", "lag", "queue_fill", "cpu")
    TIMESTAMP_FIELD_NUMBER: _ClassVar[int]
    RUN_FIELD_NUMBER: _ClassVar[int]
    SAMPLE_FIELD_NUMBER: _ClassVar[int]
    PROCESS_FIELD_NUMBER: _ClassVar[int]
    MONOTONIC_NS_FIELD_NUMBER: _ClassVar[int]
    UTC_NS_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    LEASE_HOLDER_FIELD_NUMBER: _ClassVar[int]
    FIRST_OUT_FIELD_NUMBER: _ClassVar[int]
    BACKEND_FIELD_NUMBER: _ClassVar[int]
    SAMPLES_FIELD_NUMBER: _ClassVar[int]
    LOST_FIELD_NUMBER: _ClassVar[int]
    LAG_FIELD_NUMBER: _ClassVar[int]
    QUEUE_FILL_FIELD_NUMBER: _ClassVar[int]
    CPU_FIELD_NUMBER: _ClassVar[int]
    timestamp: float
    run: str
    sample: int
    process: str
    monotonic_ns: int
    utc_ns: int
    state: str
    lease_holder: str
    first_out: str
    backend: str
    samples: int
    lost: int
    lag: float
    queue_fill: float
    cpu: float
    def __init__(self, timestamp: _Optional[float] = ..., run: _Optional[str] = ..., sample: _Optional[int] = ..., process: _Optional[str] = ..., monotonic_ns: _Optional[int] = ..., utc_ns: _Optional[int] = ..., state: _Optional[str] = ..., lease_holder: _Optional[str] = ..., first_out: _Optional[str] = ..., backend: _Optional[str] = ..., samples: _Optional[int] = ..., lost: _Optional[int] = ..., lag: _Optional[float] = ..., queue_fill: _Optional[float] = ..., cpu: _Optional[float] = ...) -> None: ...

class Description(_message.Message):
    __slots__ = ("timestamp", "run", "first_sample", "rig", "toml", "rate", "t0_ns", "t0_uncertainty_ns", "t0_source", "mode", "versions", "meta")
    class VersionsEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: str
        def __init__(self, key: _Optional[str] = ..., value: _Optional[str] = ...) -> None: ...
    class MetaEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: str
        def __init__(self, key: _Optional[str] = ..., value: _Optional[str] = ...) -> None: ...
    TIMESTAMP_FIELD_NUMBER: _ClassVar[int]
    RUN_FIELD_NUMBER: _ClassVar[int]
    FIRST_SAMPLE_FIELD_NUMBER: _ClassVar[int]
    RIG_FIELD_NUMBER: _ClassVar[int]
    TOML_FIELD_NUMBER: _ClassVar[int]
    RATE_FIELD_NUMBER: _ClassVar[int]
    T0_NS_FIELD_NUMBER: _ClassVar[int]
    T0_UNCERTAINTY_NS_FIELD_NUMBER: _ClassVar[int]
    T0_SOURCE_FIELD_NUMBER: _ClassVar[int]
    MODE_FIELD_NUMBER: _ClassVar[int]
    VERSIONS_FIELD_NUMBER: _ClassVar[int]
    META_FIELD_NUMBER: _ClassVar[int]
    timestamp: float
    run: str
    first_sample: int
    rig: str
    toml: str
    rate: float
    t0_ns: int
    t0_uncertainty_ns: int
    t0_source: str
    mode: str
    versions: _containers.ScalarMap[str, str]
    meta: _containers.ScalarMap[str, str]
    def __init__(self, timestamp: _Optional[float] = ..., run: _Optional[str] = ..., first_sample: _Optional[int] = ..., rig: _Optional[str] = ..., toml: _Optional[str] = ..., rate: _Optional[float] = ..., t0_ns: _Optional[int] = ..., t0_uncertainty_ns: _Optional[int] = ..., t0_source: _Optional[str] = ..., mode: _Optional[str] = ..., versions: _Optional[_Mapping[str, str]] = ..., meta: _Optional[_Mapping[str, str]] = ...) -> None: ...

class Command(_message.Message):
    __slots__ = ("name", "who", "lease", "values", "texts", "id")
    class ValuesEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: float
        def __init__(self, key: _Optional[str] = ..., value: _Optional[float] = ...) -> None: ...
    class TextsEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: str
        def __init__(self, key: _Optional[str] = ..., value: _Optional[str] = ...) -> None: ...
    NAME_FIELD_NUMBER: _ClassVar[int]
    WHO_FIELD_NUMBER: _ClassVar[int]
    LEASE_FIELD_NUMBER: _ClassVar[int]
    VALUES_FIELD_NUMBER: _ClassVar[int]
    TEXTS_FIELD_NUMBER: _ClassVar[int]
    ID_FIELD_NUMBER: _ClassVar[int]
    name: str
    who: str
    lease: str
    values: _containers.ScalarMap[str, float]
    texts: _containers.ScalarMap[str, str]
    id: str
    def __init__(self, name: _Optional[str] = ..., who: _Optional[str] = ..., lease: _Optional[str] = ..., values: _Optional[_Mapping[str, float]] = ..., texts: _Optional[_Mapping[str, str]] = ..., id: _Optional[str] = ...) -> None: ...

class Answer(_message.Message):
    __slots__ = ("accepted", "text", "sample", "lease")
    ACCEPTED_FIELD_NUMBER: _ClassVar[int]
    TEXT_FIELD_NUMBER: _ClassVar[int]
    SAMPLE_FIELD_NUMBER: _ClassVar[int]
    LEASE_FIELD_NUMBER: _ClassVar[int]
    accepted: bool
    text: str
    sample: int
    lease: str
    def __init__(self, accepted: _Optional[bool] = ..., text: _Optional[str] = ..., sample: _Optional[int] = ..., lease: _Optional[str] = ...) -> None: ...
