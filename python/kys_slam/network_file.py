# SPDX-License-Identifier: BSD-3-Clause
"""ONNX networks with a YAML file that says what they want and give; ONNX Runtime and its execution
providers. Without the rest of the package: tools/perception uses it too."""

import contextlib
import hashlib
import json
from pathlib import Path

import numpy as np

#: execution providers of ONNX Runtime, by the names of --segment-provider and of YAML files
PROVIDERS = {"cpu": "CPUExecutionProvider", "cuda": "CUDAExecutionProvider",
             "tensorrt": "TensorrtExecutionProvider", "openvino": "OpenVINOExecutionProvider",
             "coreml": "CoreMLExecutionProvider", "directml": "DmlExecutionProvider"}
# What reading a damaged file may raise.
BAD_CONTENT = (KeyError, ValueError, TypeError, IndexError, AttributeError, ArithmeticError, RecursionError)


class NetworkError(ValueError):
    """A network, or its YAML file, that cannot be used; the message is one line that names the file."""


def first_line(error):
    """The first line of an exception's message, or its type."""
    return (str(error).strip() or type(error).__name__).splitlines()[0]


def need():
    """NetworkError when a package is not installed."""
    for module, package in (("onnxruntime", "onnxruntime"), ("yaml", "pyyaml"),
                            ("cv2", "opencv-python-headless")):
        try:
            __import__(module)
        except ImportError:
            raise NetworkError(f"networks need {package}: pip install {package}") from None


class OnnxNetwork:
    """An ONNX network and what its YAML file says about it. A subclass reads what it needs of the file
    in _read_settings()."""

    _errors = (NetworkError,)  # that fail() raises

    def __init__(self, settings, weights=None, threads=1, provider=None):
        """threads: of one image. Results may differ by rounding with their number.
        provider: of PROVIDERS; None: what the file says, else all that there are."""
        import yaml

        self.path = Path(settings)
        with self._reading(settings):
            try:
                self.settings = yaml.safe_load(self.path.read_text(encoding="utf-8"))
            except yaml.YAMLError as error:
                self.fail(f"{settings}: {first_line(error)}")
            if not isinstance(self.settings, dict):
                self.fail(f"{settings}: is not a list of settings")
            self._read_settings()
        self.file = Path(weights) if weights else self.path.parent / str(self.settings.get("file", ""))
        self.provider = str(provider or self.settings.get("provider") or "")
        self.session = self._open_session(threads)
        self.digest = self._digest()
        self.inputs = [i.name for i in self.session.get_inputs()]
        self.outputs = [o.name for o in self.session.get_outputs()]

    def _open_session(self, threads):
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads
        options.log_severity_level = 4  # errors are raised as well
        wanted = self._providers(onnxruntime.get_available_providers())
        try:
            session = onnxruntime.InferenceSession(str(self.file), options, providers=wanted)
        except Exception as error:  # onnxruntime has no common base class of its errors
            self.fail(f"{self.file}: cannot be loaded: {first_line(error)}")
        if self.provider and wanted[0] not in session.get_providers():  # it falls back silently
            self.fail(f"{self.file}: the provider '{self.provider}' cannot be used on this machine (are its "
                      f"libraries installed?); ONNX Runtime uses {', '.join(session.get_providers())}")
        return session

    def _providers(self, available):
        """Execution providers of ONNX Runtime, the wanted one first; what it cannot do, the others do."""
        if not self.provider:
            return available
        names = [name for name, provider in PROVIDERS.items() if provider in available]
        if self.provider not in names:
            known = "is not installed" if self.provider in PROVIDERS else "is not known"
            self.fail(f"{self.path}: the provider '{self.provider}' {known}; this ONNX Runtime has: "
                      f"{', '.join(names)}")
        others = ("cuda", "cpu") if self.provider == "tensorrt" else ("cpu",)
        return list(dict.fromkeys(PROVIDERS[name] for name in (self.provider, *others) if name in names))

    @staticmethod
    def fail(message):
        """The network or its file is at fault."""
        raise NetworkError(message)

    @contextlib.contextmanager
    def _reading(self, path):
        """What is wrong with a file's content as an error that names the file."""
        try:
            yield
        except OSError as error:
            self.fail(f"{path}: {error.strerror or error}")
        except KeyError as error:
            self.fail(f"{path}: {error} is missing")
        except BAD_CONTENT as error:
            if isinstance(error, self._errors):
                raise
            self.fail(f"{path}: {first_line(error)}")

    def _digest(self):
        """SHA-256 of the ONNX file and its length."""
        with self._reading(self.file):
            data = self.file.read_bytes()
        return hashlib.sha256(len(data).to_bytes(8, "little") + data).hexdigest()

    def _read_settings(self):
        """Values of the YAML file; raises whatever a wrong one gives."""
        raise NotImplementedError

    def _read_input(self, channels=3):
        """Size, range and order of the channels (3, or 1 for grey) of the network's images."""
        size, entry = self._get("input", "size"), self.settings["input"]
        if not (isinstance(size, list) and len(size) == 2 and
                all(isinstance(v, int) and 0 < v <= 16384 for v in size)):
            self.fail(f"{self.path}: input.size is '{size}', not [height, width] in px")
        self.height, self.width = size
        self.channels = channels
        self.gamma = self._positive("input.gamma", entry.get("gamma", 1))
        self.divide_by = self._positive("input.divide_by", entry.get("divide_by", 255))
        by_channel = lambda name, default, check: np.array(
            [check(f"input.{name}", v)
             for v in np.broadcast_to(entry.get(name, default), channels).tolist()], np.float32)
        self.mean = by_channel("mean", 0, self._finite)
        self.deviation = by_channel("deviation", 1, self._positive)
        self.bgr = entry.get("colour", "rgb") == "bgr"

    def description(self, **more):
        """What its results depend on beside the images, as text."""
        return json.dumps({"settings": self.settings, "weights": self.digest, **more}, sort_keys=True,
                          default=str)

    def _finite(self, name, value):
        try:
            number = float(value)
        except (TypeError, ValueError):
            number = np.nan
        if not np.isfinite(number):
            self.fail(f"{self.path}: {name} is '{value}', not a number")
        return number

    def _positive(self, name, value):
        number = self._finite(name, value)
        if number <= 0:
            self.fail(f"{self.path}: {name} is {value}, not above 0")
        return number

    def _get(self, *keys):
        value = self.settings
        for key in keys:
            if not isinstance(value, dict) or key not in value:
                self.fail(f"{self.path}: {'.'.join(keys)} is missing")
            value = value[key]
        return value

    def prepare(self, image):
        """(1, channels, h, w) float32 of an (H, W, 3) RGB image."""
        import cv2

        if self.channels == 1:
            image = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
        if self.gamma != 1:
            image = (255 * (np.arange(256) / 255) ** self.gamma).astype(np.uint8)[image]
        scaled = self._fitted(image).astype(np.float32).reshape(self.height, self.width, self.channels)
        scaled /= self.divide_by
        scaled -= self.mean
        scaled /= self.deviation
        if self.bgr:
            scaled = scaled[:, :, ::-1]
        return np.ascontiguousarray(scaled.transpose(2, 0, 1)[None])

    def _fitted(self, image):
        """At the size of the network's input."""
        import cv2

        return cv2.resize(image, (self.width, self.height), interpolation=cv2.INTER_LINEAR)

    def _outputs_of(self, tensors, names):
        """Outputs of these names (all for None), by name, for prepared images by name of the input."""
        try:
            values = self.session.run(names, tensors)
        except Exception as error:  # onnxruntime has no common base class of its errors
            self.fail(f"{self.file}: takes no images of {self.width}x{self.height} px (input.size of "
                        f"{self.path}): {first_line(error)}")
        return dict(zip(names or self.outputs, values))

    def _check_output(self, key, name):
        """The name of an output as output.KEY gives it; it must be one of the network."""
        if name not in self.outputs:
            self.fail(f"{self.path}: output.{key} is '{name}', the network has "
                        f"{', '.join(self.outputs)}")
        return name
