import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from daq.messages import SeriesEncoder, decode_series, read_header
from daq.messages_pb2 import Event, Status
from daq.series_layout import HeaderLayout, Layout, SeriesDecoder, variable

RUNS = st.sampled_from(["run-1", "", "r", "ü" * 70])
CHANNELS = st.lists(st.tuples(st.text(max_size=5), st.text(max_size=3)), max_size=4)
INDICES = st.one_of(st.integers(0, 300), st.integers(0, 2**63))
STATUSES = st.integers(0, 2**32 - 1)
TIMES = st.sampled_from([0.0, 1.0, 1.8e9])


@st.composite
def encoders(draw):
    """An encoder and a function that makes messages with it."""
    channels = draw(CHANNELS)
    names, units = [name for name, _ in channels], [unit for _, unit in channels]
    encoder = SeriesEncoder(draw(RUNS), 25000.0, names, units, draw(st.sampled_from([0, 5, 300])))

    def make(columns: int, time: float, first: int, status: int) -> bytes:
        bits = np.random.default_rng(first % 1000).integers(0, 2**32, (len(names), columns), np.uint32)
        return encoder.encode(time, first, status, bits.view(np.float32))

    return make


def equal(found, payload: bytes) -> bool:
    """Samples are compared as bytes: there may be NaN among them."""
    return found == variable(decode_series(payload))


VALUES = st.tuples(TIMES, INDICES, STATUSES)


@given(encoders(), st.integers(0, 60), VALUES, VALUES)
def test_messages_laid_out_alike_read_as_when_decoded(make, columns, before, now):
    learned, other = make(columns, *before), make(columns, *now)
    found = Layout(decode_series(learned)).read(other)
    assert found is None or equal(found, other)
    if now[0] and decode_series(other).run:
        assert found is not None


@given(encoders(), encoders(), st.integers(0, 5), st.integers(0, 5), INDICES, STATUSES)
def test_messages_laid_out_otherwise_are_left_to_the_decoder(
    make, make_other, columns, others, first, status
):
    learned, other = make(columns, 1.0, first, status), make_other(others, 1.0, first, status)
    found = Layout(decode_series(learned)).read(other)
    assert found is None or equal(found, other)


@given(encoders(), encoders(), st.lists(st.tuples(st.booleans(), st.integers(0, 3), VALUES)))
def test_the_quick_decoder_says_what_the_decoder_says(make, make_other, messages):
    decoder = SeriesDecoder()
    for other, columns, values in messages:
        payload = (make_other if other else make)(columns, *values)
        extent, found, expected = decoder.extent(payload), decoder.decode(payload), decode_series(payload)
        assert extent == (expected.first_sample, expected.samples.shape[1])
        assert found._replace(samples=None) == expected._replace(samples=None)
        assert found.samples.tobytes() == expected.samples.tobytes()
        assert found.samples.shape == expected.samples.shape
        assert found.samples.flags.writeable


@given(encoders(), st.integers(1, 5), st.integers(0, 400), INDICES)
def test_cut_off_messages_are_left_to_the_decoder(make, columns, size, first):
    payload = make(columns, 1.0, first, 3)
    if size < len(payload):
        assert Layout(decode_series(payload)).read(payload[:size]) is None


@given(RUNS, RUNS, TIMES, INDICES)
def test_headers_read_as_when_decoded(run, other, time, sample):
    for message in (Event, Status):
        payload = message(timestamp=time, run=run, sample=sample).SerializeToString()
        for known in (run, other):
            found = HeaderLayout(known).read(payload)
            assert found is None or (found == read_header(payload).sample and known == run)
    assert HeaderLayout(run).read(b"") is None
