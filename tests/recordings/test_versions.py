"""A recording of each released version stays readable, by this version and by its own schemas."""

import json

import pytest
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from mcap.reader import make_reader

from daq import messages_pb2
from daq.recording import Recording
from replay.pieces import Stretch
from tests.recordings.make_fixture import FOLDER, facts

FIXTURES = sorted(FOLDER.glob("*.mcap"))
EACH = pytest.mark.parametrize("path", FIXTURES, ids=lambda path: path.stem)


def test_there_is_a_fixture():
    assert FIXTURES[0].stem == "0.1.0"


@EACH
def test_it_is_read_as_it_was_written(path):
    told = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
    assert json.loads(json.dumps(facts(path))) == told
    with Recording(path) as recording:
        assert recording.check().verdict == "valid"
    with Stretch(path, "estimate") as stretch:
        last = list(stretch.pieces())[-1]
        assert dict(zip(last.names, last.samples[:, -1].tolist(), strict=True)) == told["last"]["estimate"]


@EACH
def test_its_schemas_are_still_ours(path):
    """Each field of then is here now, with its number and type; old readers skip what was added since."""
    pool = DescriptorPool()
    names = set()
    with path.open("rb") as file:
        for schema in make_reader(file).get_summary().schemas.values():
            names.add(schema.name)
            for each in FileDescriptorSet.FromString(schema.data).file:
                pool.AddSerializedFile(each.SerializeToString())
    assert "rigtwin.v1.Block" in names
    for name in names:
        now = messages_pb2.DESCRIPTOR.message_types_by_name[name.rpartition(".")[2]].fields_by_number
        for field in GetMessageClass(pool.FindMessageTypeByName(name)).DESCRIPTOR.fields:
            same = now[field.number]
            assert (same.name, same.type, same.is_repeated) == (field.name, field.type, field.is_repeated)
