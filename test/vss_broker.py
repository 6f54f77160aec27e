# SPDX-License-Identifier: Apache-2.0
"""
A databroker of VSS data in the test's own process, made from the protocol definitions of kuksa-client.

It knows a few paths with type and unit, sends values on change only, and passes requests for actuators to their
provider. With `v2=False` it offers the first version of the protocol alone.
"""

from concurrent.futures import ThreadPoolExecutor
from queue import Empty, SimpleQueue
import threading

from google.protobuf.timestamp_pb2 import Timestamp
import grpc
from kuksa.val.v1 import types_pb2 as types_v1
from kuksa.val.v1 import val_pb2 as val_v1
from kuksa.val.v1 import val_pb2_grpc as grpc_v1
from kuksa.val.v2 import types_pb2 as types_v2
from kuksa.val.v2 import val_pb2 as val_v2
from kuksa.val.v2 import val_pb2_grpc as grpc_v2
from waiting import poll_until, TIME_LIMIT_S

PACK = 'Vehicle.Powertrain.TractionBattery'
CONDITIONING = f'{PACK}.BatteryConditioning'
KINDS = {'float': types_v1.DATA_TYPE_FLOAT, 'bool': types_v1.DATA_TYPE_BOOLEAN,
         'string': types_v1.DATA_TYPE_STRING}
# Units as the VSS catalogue writes them.
PATHS = {f'{PACK}.Temperature.Average': ('float', 'celsius'), f'{PACK}.Temperature.Min': ('float', 'celsius'),
         f'{PACK}.Temperature.Max': ('float', 'celsius'), f'{PACK}.StateOfCharge.Current': ('float', 'percent'),
         f'{PACK}.CurrentVoltage': ('float', 'V'), f'{PACK}.CurrentCurrent': ('float', 'A'),
         f'{PACK}.Charging.IsCharging': ('bool', ''), f'{CONDITIONING}.RequestedMode': ('string', ''),
         f'{CONDITIONING}.TargetTemperature': ('float', 'celsius'),
         f'{CONDITIONING}.TargetTime': ('string', 'iso8601'),
         f'{CONDITIONING}.IsActive': ('bool', ''), f'{CONDITIONING}.IsOngoing': ('bool', ''),
         'Vehicle.Speed': ('float', 'km/h'), 'Vehicle.Exterior.AirTemperature': ('float', 'celsius')}


class Broker:
    """The broker; `values` are the current values by path, `history` every value that a client has published."""

    def __init__(self, v2=True, port=0):
        """Start a server on a port of the loopback interface."""
        self.values, self.stamps, self.history = {}, {}, []
        self._watchers, self._providers = [], []
        self._lock = threading.Lock()
        self._server = grpc.server(ThreadPoolExecutor(max_workers=20))
        grpc_v1.add_VALServicer_to_server(_First(self), self._server)
        if v2:
            grpc_v2.add_VALServicer_to_server(_Second(self), self._server)
        self.port = self._server.add_insecure_port(f'127.0.0.1:{port}')
        self._server.start()

    def close(self):
        self._server.stop(0.0).wait()

    def set(self, path, value):
        """Set a current value, as its provider does; None: not available."""
        with self._lock:
            self.values[path] = value
            self.stamps[path] = Timestamp()
            self.stamps[path].GetCurrentTime()
            for paths, queue in self._watchers:
                if path in paths:
                    queue.put({path: value})

    def published(self, path, value):
        """Set a value that a client has published."""
        self.history.append((path, value))
        self.set(path, value)

    def request(self, values):
        for queue in list(self._providers):
            queue.put(dict(values))

    def has_provider(self):
        return bool(self._providers)

    def wait_for(self, path, value, timeout_s=TIME_LIMIT_S):
        poll_until(lambda: self.values.get(path) == value, f'{path} = {value}', timeout_s)

    def updates(self, paths, context):
        """Yield dictionaries of values that have changed; the current ones first."""
        queue = SimpleQueue()
        with self._lock:
            queue.put({path: self.values[path] for path in paths if path in self.values})
            self._watchers.append((paths, queue))
        yield from _queued(queue, context)

    def requests(self, context):
        """Yield dictionaries of requested values."""
        queue = SimpleQueue()
        self._providers.append(queue)
        try:
            yield from _queued(queue, context)
        finally:
            self._providers.remove(queue)


def _queued(queue, context):
    while context.is_active():
        try:
            yield queue.get(timeout=0.05)
        except Empty:
            continue


class _First(grpc_v1.VALServicer):
    def __init__(self, broker):
        self._broker = broker

    def GetServerInfo(self, request, context):  # noqa: N802
        return val_v1.GetServerInfoResponse(name='test', version='0')

    def Get(self, request, context):  # noqa: N802
        response = val_v1.GetResponse()
        for wanted in request.entries:
            for path, (kind, unit) in PATHS.items():
                if path == wanted.path or path.startswith(f'{wanted.path}.'):
                    entry = response.entries.add(path=path)
                    entry.metadata.data_type = KINDS[kind]
                    entry.metadata.unit = unit
        return response

    def Set(self, request, context):  # noqa: N802
        for update in request.updates:
            value = update.entry.value
            self._broker.published(update.entry.path, getattr(value, value.WhichOneof('value')))
        return val_v1.SetResponse()

    def Subscribe(self, request, context):  # noqa: N802
        paths = {entry.path for entry in request.entries}
        is_target = types_v1.FIELD_ACTUATOR_TARGET in request.entries[0].fields
        for values in self._broker.requests(context) if is_target else self._broker.updates(paths, context):
            response = val_v1.SubscribeResponse()
            for path, value in values.items():
                update = response.updates.add()
                update.entry.path = path
                point = update.entry.actuator_target if is_target else update.entry.value
                if value is not None:
                    setattr(point, PATHS[path][0], value)
                    if not is_target:
                        point.timestamp.CopyFrom(self._broker.stamps[path])
            yield response


class _Second(grpc_v2.VALServicer):
    def __init__(self, broker):
        self._broker = broker

    def _identifier(self, path):
        return list(PATHS).index(path)

    def ListMetadata(self, request, context):  # noqa: N802
        return val_v2.ListMetadataResponse(metadata=[
            types_v2.Metadata(path=path, id=self._identifier(path)) for path in PATHS
            if path == request.root or path.startswith(f'{request.root}.')])

    def Subscribe(self, request, context):  # noqa: N802
        for path in request.signal_paths:
            if path not in PATHS:
                context.abort(grpc.StatusCode.NOT_FOUND, path)
        for values in self._broker.updates(set(request.signal_paths), context):
            response = val_v2.SubscribeResponse()
            for path, value in values.items():
                point = response.entries[path]
                point.timestamp.CopyFrom(self._broker.stamps[path])
                if value is not None:
                    setattr(point.value, PATHS[path][0], value)
            yield response

    def PublishValue(self, request, context):  # noqa: N802
        value = request.data_point.value
        self._broker.published(request.signal_id.path, getattr(value, value.WhichOneof('typed_value')))
        return val_v2.PublishValueResponse()

    def OpenProviderStream(self, request_iterator, context):  # noqa: N802
        next(request_iterator)
        for values in self._broker.requests(context):
            response = val_v2.OpenProviderStreamResponse()
            for path, value in values.items():
                request = response.batch_actuate_stream_request.actuate_requests.add()
                request.signal_id.id = self._identifier(path)
                setattr(request.value, PATHS[path][0], value)
            yield response
