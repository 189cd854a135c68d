"""The vendor's side of the bridge: DepthAI frames into shared memory, their facts into a socket.

Started by the driver `depthai` as `python3 -c THIS`. Descriptor 0 is one end of a socket pair: messages
of four bytes of length (little-endian) and that many of JSON, both ways. Descriptor 1 is an anonymous
file of equal slots that frames are copied into; a slot is the driver's until it releases it. Ends when
the socket does.
"""

import datetime
import json
import mmap
import os
import queue
import socket
import struct
import sys
import threading
import time

SLOTS = 8
# A recording that says nothing for so long is at its end.
END_SECONDS = 2.0


class Refusal(Exception):
    """What the driver is told instead of frames."""

    def __init__(self, kind, message):
        super().__init__(message)
        self.kind = kind


class Line:
    """The socket."""

    def __init__(self, descriptor):
        self.socket = socket.socket(fileno=descriptor)
        self.sending = threading.Lock()

    def send(self, **message):
        body = json.dumps(message).encode()
        with self.sending:
            self.socket.sendall(struct.pack("<I", len(body)) + body)

    def receive(self):
        """The next message; None at the end."""
        head = self.exactly(4)
        body = head and self.exactly(struct.unpack("<I", head)[0])
        return json.loads(body) if body else None

    def exactly(self, count):
        parts = b""
        while len(parts) < count:
            part = self.socket.recv(count - len(parts))
            if not part:
                return None
            parts += part
        return parts


class Slots:
    """The shared memory."""

    def __init__(self, descriptor, size):
        os.ftruncate(descriptor, SLOTS * size)
        self.size = size
        self.memory = mmap.mmap(descriptor, SLOTS * size)
        self.free = queue.SimpleQueue()
        for slot in range(SLOTS):
            self.free.put(slot)

    def store(self, planes):
        """The slot the planes lie in, one after the other; None when all are taken: the driver is
        slow, and the frame is lost."""
        try:
            slot = self.free.get_nowait()
        except queue.Empty:
            return None
        at = slot * self.size
        for plane in planes:
            data = plane.tobytes()
            self.memory[at : at + len(data)] = data
            at += len(data)
        return slot


def nanoseconds(delta):
    # Whole microseconds: floats would lose the last digits.
    return (delta.days * 86_400_000_000 + delta.seconds * 1_000_000 + delta.microseconds) * 1000


def packed(frame, bytes_per_pixel):
    """The rows of a frame without padding."""
    import numpy

    width, height, stride = frame.getWidth(), frame.getHeight(), frame.getStride()
    data = numpy.asarray(frame.getData(), dtype=numpy.uint8).ravel()
    row = width * bytes_per_pixel
    stride = stride if stride >= row else row
    if data.size < stride * (height - 1) + row:
        raise Refusal("malformed", f"{data.size} bytes for {width}x{height} pixels of {bytes_per_pixel} bytes")
    rows = numpy.lib.stride_tricks.as_strided(data, (height, row), (stride, 1))
    return numpy.ascontiguousarray(rows)


def lens(calibration, socket_id, width, height):
    model = str(calibration.getDistortionModel(socket_id)).rsplit(".", 1)[-1]
    if model != "Perspective":
        raise Refusal("setting", f"the lens model {model} of {socket_id} is not supported; only Perspective is")
    matrix = calibration.getCameraIntrinsics(socket_id, width, height)
    bend = list(calibration.getDistortionCoefficients(socket_id)) + [0.0] * 8
    names = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
    return {
        "width": width,
        "height": height,
        "fx": matrix[0][0],
        "fy": matrix[1][1],
        "cx": matrix[0][2],
        "cy": matrix[1][2],
        "distortion": dict(zip(names, bend)),
    }


class Camera:
    """An OAK with a color camera and a ToF camera."""

    def __init__(self, dai, asked):
        self.dai = dai
        wanted = asked["id"]
        found = dai.Device.getAllAvailableDevices()
        chosen = [info for info in found if not wanted or info.deviceId == wanted]
        if not chosen:
            raise Refusal("absent", f"no DepthAI device {wanted or ''}; found {[info.deviceId for info in found]}")
        device = dai.Device(chosen[0])
        self.device = device
        features = {f.socket: f for f in device.getConnectedCameraFeatures()}
        tofs = [s for s, f in features.items() if dai.CameraSensorType.TOF in f.supportedTypes]
        colors = [s for s, f in features.items() if dai.CameraSensorType.COLOR in f.supportedTypes]
        if not tofs or not colors:
            raise Refusal("absent", f"{device.getProductName()} lacks a color or a ToF camera")
        self.pipeline = dai.Pipeline(device)
        size = (asked["width"], asked["height"])
        camera = self.pipeline.create(dai.node.Camera).build(colors[0], sensorFps=asked["rate"])
        output = camera.requestOutput(size, dai.ImgFrame.Type.RGB888i, enableUndistortion=False)
        tof = self.pipeline.create(dai.node.ToF).build(tofs[0], fps=asked["rate"])
        tof.setOutputUndistortion(False)
        self.color = output.createOutputQueue(4, False)
        self.depth = [out.createOutputQueue(4, False) for out in (tof.depth, tof.amplitude, tof.confidence)]
        self.control = camera.inputControl.createInputQueue()
        initial = camera.initialControl
        initial.setAutoFocusMode(dai.CameraControl.AutoFocusMode.OFF)
        modes = dai.CameraControl.FrameSyncMode
        initial.setFrameSyncMode({"off": modes.OFF, "input": modes.INPUT, "output": modes.OUTPUT}[asked["sync"]])
        initial.setStrobeDisable()
        self.strobe_line = asked["strobe"]
        feature = features[tofs[0]]
        calibration = device.readCalibration()
        # As [rotation | translation], depth to color.
        step = calibration.getCameraExtrinsics(tofs[0], colors[0], unit=dai.LengthUnit.METER)
        self.rig = {
            "model": device.getProductName(),
            "id": device.getDeviceId(),
            "color": lens(calibration, colors[0], *size),
            "depth": lens(calibration, tofs[0], feature.width, feature.height),
            "rotation": [row[:3] for row in step[:3]],
            "translation_metres": [row[3] for row in step[:3]],
        }

    def expose(self, microseconds, iso):
        if microseconds is not None:
            control = self.dai.CameraControl()
            control.setManualExposure(microseconds, iso)
            self.control.send(control)

    def strobe(self, on):
        control = self.dai.CameraControl()
        if not on:
            control.setStrobeDisable()
        elif self.strobe_line is None:
            control.setStrobeSensor(1)
        else:
            control.setStrobeExternal(self.strobe_line, 1)
        self.control.send(control)


class Replay:
    """A recording, through a pipeline that runs on this computer alone: `color.avi` and `color.mcap` as
    DepthAI's RecordVideo writes them, `depth.npy` and `amplitude.npy` (frames, rows, columns; 16 bits,
    millimetres), `rig.json` in the form of the message `ready`, and the exposure of all color frames."""

    def __init__(self, dai, asked):
        import numpy

        folder = asked["replay"]
        try:
            with open(os.path.join(folder, "rig.json"), encoding="utf-8") as file:
                self.rig = json.load(file)
            planes = [
                numpy.load(os.path.join(folder, name), mmap_mode="r", allow_pickle=False)
                for name in ("depth.npy", "amplitude.npy")
            ]
        except (OSError, ValueError) as error:
            raise Refusal("absent", f"{folder}: {error}") from error
        for plane in planes:
            if plane.dtype != numpy.uint16 or plane.ndim != 3 or plane.shape != planes[0].shape:
                raise Refusal("malformed", f"{folder}: {plane.dtype} {plane.shape} is not frames of 16 bits of one size")
        self.exposure = self.rig.pop("exposure")
        self.pipeline = dai.Pipeline(False)
        video = self.pipeline.create(dai.node.ReplayVideo)
        video.setReplayVideoFile(os.path.join(folder, "color.avi"))
        video.setReplayMetadataFile(os.path.join(folder, "color.mcap"))
        video.setOutFrameType(dai.ImgFrame.Type.RGB888i)
        video.setLoop(False)

        class Planes(dai.node.ThreadedHostNode):
            """Gives out a depth frame for each color frame, at its time."""

            def __init__(self):
                super().__init__()
                self.beat = self.createInput()
                self.outputs = [self.createOutput(), self.createOutput()]

            def run(self):
                for images in zip(*planes):
                    if not self.isRunning():
                        return
                    color = self.beat.get()
                    for image, output in zip(images, self.outputs):
                        frame = dai.ImgFrame()
                        frame.setType(dai.ImgFrame.Type.RAW16)
                        frame.setWidth(image.shape[1])
                        frame.setHeight(image.shape[0])
                        frame.setStride(2 * image.shape[1])
                        frame.setData(numpy.ascontiguousarray(image).view(numpy.uint8).ravel())
                        frame.setSequenceNum(color.getSequenceNum())
                        frame.setTimestamp(color.getTimestamp())
                        frame.setTimestampDevice(color.getTimestampDevice())
                        output.send(frame)

        planes_node = self.pipeline.create(Planes)
        video.out.link(planes_node.beat)
        self.color = video.out.createOutputQueue(256, True)
        self.depth = [output.createOutputQueue(256, True) for output in planes_node.outputs]

    def expose(self, microseconds, iso):
        pass

    def strobe(self, on):
        pass


class Bridge:
    def __init__(self, line, memory, asked):
        try:
            import depthai
        except ImportError as error:
            raise Refusal("missing", f"the Python package depthai cannot be loaded ({error}); pip install depthai") from error
        self.line = line
        self.running = True
        source = Replay if asked["replay"] else Camera
        try:
            self.source = source(depthai, asked)
        except RuntimeError as error:
            raise Refusal("device", str(error)) from error
        color, depth = self.source.rig["color"], self.source.rig["depth"]
        size = max(3 * color["width"] * color["height"], 6 * depth["width"] * depth["height"])
        self.slots = Slots(memory, size)
        line.send(ready=dict(self.source.rig, slots=SLOTS, slot_bytes=size))

    def facts(self, frame, synced):
        offset = self.start_offset()
        device = frame.getTimestampDevice(*offset)
        return {
            "sequence": frame.getSequenceNum(),
            "device_ns": nanoseconds(device),
            "stamp_ns": nanoseconds(frame.getTimestamp(*offset)) if synced else time.monotonic_ns(),
        }

    def start_offset(self):
        import depthai

        return (depthai.CameraExposureOffset.START,)

    def color(self):
        synced = isinstance(self.source, Camera)
        for frame in self.frames(self.source.color):
            if synced:
                exposure = {
                    "seconds": frame.getExposureTime().total_seconds(),
                    # ISO 100 is base gain.
                    "gain": frame.getSensitivity() / 100.0,
                }
            else:
                exposure = self.source.exposure
            self.give("color", [packed(frame, 3)], exposure=exposure, **self.facts(frame, synced))

    def depth(self):
        synced = isinstance(self.source, Camera)
        waiting = {}
        queues = self.source.depth
        for frame in self.frames(queues[0]):
            number = frame.getSequenceNum()
            planes = [packed(frame, 2)]
            for index, other in enumerate(queues[1:]):
                match = waiting.pop((index, number), None)
                while match is None:
                    found = other.get()
                    if found.getSequenceNum() >= number:
                        match = found
                if match.getSequenceNum() != number:
                    waiting[(index, match.getSequenceNum())] = match
                    break
                planes.append(packed(match, 2))
            else:
                names = ["amplitude", "confidence"][: len(planes) - 1]
                self.give("depth", planes, planes=names, **self.facts(frame, synced))

    def frames(self, source):
        while self.running:
            if isinstance(self.source, Camera):
                yield source.get()
                continue
            frame = source.get(datetime.timedelta(seconds=END_SECONDS))
            if frame is None:
                raise Refusal("ended", "end of recording")
            yield frame

    def give(self, camera, images, **facts):
        slot = self.slots.store(images)
        if slot is not None:
            size = sum(image.nbytes for image in images)
            self.line.send(frame=dict(facts, camera=camera, slot=slot, bytes=size))

    def guarded(self, work):
        """Runs one camera; its end is told."""
        try:
            work()
        except Exception as error:
            # Mostly what a queue says whose pipeline is over or whose device is gone; whatever it is,
            # the driver must not wait for it in vain.
            kind = getattr(error, "kind", "ended" if isinstance(self.source, Replay) else "lost")
            if self.running:
                self.running = False
                self.tell(kind, str(error))

    def tell(self, kind, message):
        try:
            self.line.send(error={"kind": kind, "message": message})
        except OSError:
            pass

    def obey(self):
        """Until the driver goes."""
        started = False
        while (message := self.line.receive()) is not None:
            if "start" in message and not started:
                started = True
                self.source.pipeline.start()
                asked = message["start"]
                self.source.expose(asked["exposure_us"], asked["iso"])
                for work in (self.color, self.depth):
                    threading.Thread(target=self.guarded, args=(work,), daemon=True).start()
            elif "release" in message:
                self.slots.free.put(message["release"])
            elif "strobe" in message:
                self.source.strobe(message["strobe"])
        self.running = False
        self.source.strobe(False)


def main():
    line = Line(os.dup(0))
    memory = os.dup(1)
    # The vendor's library prints; what it prints is log.
    os.dup2(2, 1)
    try:
        asked = line.receive()
        if asked:
            bridge = Bridge(line, memory, asked["open"])
            bridge.obey()
    except Refusal as refusal:
        line.send(error={"kind": refusal.kind, "message": str(refusal)})
    except (BrokenPipeError, ConnectionResetError):
        pass
    sys.stderr.flush()
    # Threads of the library outlive their device; nothing is left to clean up.
    os._exit(0)


main()
