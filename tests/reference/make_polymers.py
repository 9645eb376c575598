"""Makes tests/data/polymers.json: polymers under JKR contact, engaged in time; and compares phasemap with them.

    python tests/reference/make_polymers.py make|detune|wild [COUNT]
    python tests/reference/make_polymers.py compare [SOLVER]

`detune` makes tests/data/polymers_detuned.json and `wild` polymers_wild.json instead; `compare` takes all three.

Nothing here is shared with phasemap or with the other references but the equation of motion and the contact law. It
needs a C compiler: `polymers.c`, which has the equation of motion, is compiled into a temporary folder.

Polymers.  20 MPa to 1 GPa, 0.02 to 0.1 J/m2, damping 0.002 to 0.05; tips of 5 to 20 nm; levers of 2 to 40 N/m, 60 to
350 kHz, Q 100 to 600, 10 to 100 nm of free amplitude, all drawn evenly in their logarithm; a decay length of 0.3 nm
for two in three, none for the others. Those whose loop of contact and release would create energy are drawn again.
Detuned: `frequency_ratio`, drive over resonance frequency, evenly from 0.98 to 1.02; what was drawn for the free
amplitude is the one at that frequency, and `free_amplitude` what the same drive would give at resonance.

Engagement.  A lever that swings freely comes down by SPEED a ring-down time (Q/pi periods): a fifteenth of the decay
length, and at most 1/500 of the amplitude, so that the amplitude trails that of a tip at rest by this little. Where the
amplitude behind a low-pass of one ring-down time comes near a setpoint, an integral feedback takes over without a jump:
it lowers the tip by GAIN of the amplitude's error a ring-down time, at most by SPEED.
* Periodic: held until phasors of the last 50 periods are within 3e-8 of the amplitude and so is the setpoint. With
  steps good to TOLERANCE of the amplitude phases are good to 1e-4 degree, of two of 233 to 3e-4 (polymers 32 and 43,
  made again with 1e-12), and tip offsets to 0.1 pm.
  A tip that is pressed in, whose amplitude hardly goes with z0, is waited for with FASTER feedback.
* Otherwise the mean phasor of groups of 16 ring-down times, with half the gain. They are averaged until the standard
  errors of phase and tip offset are 0.003 degree and 0.5 pm.

Which pattern of taps is held (in 3 periods of 7, or in 4 of 9) may depend on the way. `near` lists [tip offset, phase] of
what is held after an approach 2.5 times as fast from elsewhere, after one by 0.004 of the amplitude a ring-down time, and
after kicks of 1e-3 of the amplitude, which is what thermal noise does. Where it differs from the first by more than the
tolerance, the answer is defined only to that. The file has it of polymers 0 to 62 and of some of the others, and the
second of these ways for four setpoints only.

Fields of each setpoint: tip_offset [m], phase [degree] = 90 - lag of the mean phasor; period (of the motion, in periods
of the drive; 0: none up to 12); phase_error, tip_offset_error (standard errors), phase_spread [degree] and
amplitude_spread [m] behind exp(-2 pi/100) per period, contact_share (share of periods with contact); held.
"""

import ctypes
import json
import math
import pathlib
import subprocess
import sys
import tempfile

import numpy as np
from scipy.integrate import DOP853

HERE = pathlib.Path(__file__).parent
OUT = HERE.parent / "data" / "polymers.json"
DETUNED, WILDEST = OUT.with_name("polymers_detuned.json"), OUT.with_name("polymers_wild.json")
SEED, COUNT, SETPOINTS = 20261122, 100, (0.9, 0.7, 0.5)
SPEED, GAIN = 0.02, 0.1  # nm and share of the error, in a ring-down time
TOLERANCE = 3e-11  # error of a step, over the free amplitude
MOST = 300_000  # periods in which a setpoint is held
SLOWEST, FASTER = 1000, 5  # groups of periods in which one settles whose amplitude hardly goes with z0; over GAIN then
LOST = 3  # free amplitudes below the surface, where a tip is given up
FAST = 4e-3  # of the free amplitude, in a ring-down time
KICK = 1e-3  # of the free amplitude
POISSON = 0.35
WILD = [
    {
        "modulus": 31.9e6, "adhesion": 0.2976, "damping": 0.04332, "tip_radius": 4.363e-9, "stiffness": 4.867,
        "resonance_frequency": 300e3, "quality_factor": 50.87, "free_amplitude": 18.3e-9, "decay_length": 0.1039e-9,
    },
]  # fmt: skip
"""Held in 6 periods of 19 after each approach and kick; a tip that is moved faster while it is held takes to another."""
REAL = "omega alpha0 drive pull reach force depth damping tolerance release lam first fold z0 z v theta step touched zc zs x"
JKR, MAUGIS, DMT = range(3)


class Tip(ctypes.Structure):
    """As in polymers.c, lengths in nm."""

    _fields_ = [(name, ctypes.c_double) for name in REAL.split()] + [("state", ctypes.c_int), ("law", ctypes.c_int)]


def compiled():
    """polymers.c with the tableau of Dormand and Prince, as scipy has it."""

    def table(name, array):
        size = "".join(f"[{n}]" for n in array.shape)
        values = ", ".join(repr(float(value)) for value in array.ravel())
        return f"static const double {name}{size} = {{{values}}};\n"

    folder = pathlib.Path(tempfile.mkdtemp())
    tables = {"a": DOP853.A[:12, :12], "b": DOP853.B, "c": DOP853.C[:12], "e3": DOP853.E3[:12], "e5": DOP853.E5[:12]}
    text = "#define STAGES 12\n" + "".join(table(name, array) for name, array in tables.items())
    (folder / "tableau.h").write_text(text)
    flags = "-O3 -march=native -fno-math-errno -fno-trapping-math -Wno-missing-braces -D_GNU_SOURCE -shared -fPIC"
    out = folder / "polymers.so"
    subprocess.run(
        ["cc", *flags.split(), f"-I{folder}", "-o", str(out), str(HERE / "polymers.c"), "-lm"],  # noqa: S607
        check=True,
    )
    library, real = ctypes.CDLL(str(out)), ctypes.c_double
    numbers = ctypes.POINTER(real)
    library.follow.argtypes = [ctypes.POINTER(Tip), numbers, real, real, real, real, ctypes.c_long, numbers]
    library.follow.restype = ctypes.c_long
    library.dugdale.argtypes = [real, real, numbers, numbers, numbers]
    library.contact.argtypes = library.away.argtypes = [ctypes.POINTER(Tip), real]
    library.contact.restype = library.away.restype = real
    return library


def loop_energy(case):
    """What a loop of contact and release loses [J]: that of JKR less the long-range force's work up to release."""
    modulus, radius, w = case["modulus"] / (1 - POISSON**2), case["tip_radius"], case["adhesion"]
    lost, reach = 7.0922 * (w**5 * radius**4 / modulus**2) ** (1 / 3), case["decay_length"]
    if reach:
        release = 1.6088 * (w**2 * radius / modulus**2) ** (1 / 3)
        lost -= 2 * math.pi * w * radius * reach * (1 - 1 / (1 + release / reach))
    return lost


def draw(count, detuned=False):
    rng, cases = np.random.default_rng(SEED + detuned), []

    def between(low, high):
        return float(f"{math.exp(rng.uniform(math.log(low), math.log(high))):.4g}")

    while len(cases) < count:
        case = {
            "modulus": between(20e6, 1e9), "adhesion": between(0.02, 0.1), "damping": between(0.002, 0.05),
            "tip_radius": between(5e-9, 20e-9), "stiffness": between(2, 40), "resonance_frequency": between(60e3, 350e3),
            "quality_factor": between(100, 600), "free_amplitude": between(10e-9, 100e-9),
            "decay_length": 0.3e-9 if rng.uniform() < 2 / 3 else None,
        }  # fmt: skip
        if detuned:
            ratio = case["frequency_ratio"] = float(f"{rng.uniform(0.98, 1.02):.6g}")
            gain = 1 / math.hypot(case["quality_factor"] * (1 - ratio**2), ratio)
            case["free_amplitude"] = float(f"{case['free_amplitude'] / gain:.4g}")
        if loop_energy(case) > 0:
            cases.append(case)
    return cases


def jkr(case):
    """What `Tip` has of the contact, in nm."""
    stiff, radius = 4 / 3 * case["modulus"] / (1 - POISSON**2), case["tip_radius"]
    s_c6 = 2 * math.pi * case["adhesion"] * radius**2 / (12 * stiff)
    depth = s_c6 ** (2 / 3) / radius * 1e9
    return {
        "law": JKR, "force": stiff / radius * s_c6 / case["stiffness"] * 1e9, "depth": depth, "release": -3.0 * depth,
        "first": 4 ** (1 / 3),
    }  # fmt: skip


class Run:
    """A tip in time, and the phasors behind the low-passes of `follow`."""

    def __init__(self, library, case, speed=SPEED, start=0.0):
        radius, k, reach = case["tip_radius"], case["stiffness"], (case["decay_length"] or 0.0) * 1e9
        pull = 2 * math.pi * case["adhesion"] * radius
        contact = case.get("tip") or jkr(case)
        omega, alpha0 = case.get("frequency_ratio", 1.0), 0.5 / case["quality_factor"]
        drive = case["free_amplitude"] * 1e9 / case["quality_factor"]
        free = drive / complex(1 - omega**2, 2 * alpha0 * omega)  # z = Re(free exp(i theta)), z' = Re(i omega free ...)
        self.library, self.amplitude, self.speed = library, abs(free), speed
        self.ring = case["quality_factor"] * omega / math.pi
        self.tip = Tip(
            omega=omega, alpha0=alpha0, drive=drive,
            pull=pull / k * 1e9 if reach else 0.0, reach=reach,
            damping=case["damping"] / math.sqrt(radius * 1e9), tolerance=TOLERANCE * self.amplitude,
            z=free.real, v=-omega * free.imag, step=0.01, x=contact["first"],
            z0=self.amplitude + 12 * reach + 0.5 + start, **contact,
        )  # fmt: skip
        self.slow = np.array([free.real, free.imag] * 2)

    def copy(self):
        other = object.__new__(Run)
        other.__dict__ = self.__dict__ | {"tip": Tip.from_buffer_copy(self.tip), "slow": self.slow.copy()}
        return other

    def pass_periods(self, count, target, gain, until=-1.0, record=True):
        """Rows of phasor (2), z0, whether it touched, phasor of the narrow lock-in (2); or the periods done."""
        rows = np.zeros((count, 6)) if record else None
        real = ctypes.POINTER(ctypes.c_double)
        to = rows.ctypes.data_as(real) if record else None
        slow = self.slow.ctypes.data_as(real)
        done = self.library.follow(ctypes.byref(self.tip), slow, target, gain, self.speed, until, count, to)
        if done < 0 or self.tip.z0 < -LOST * self.amplitude:
            raise OverflowError("the tip is lost")
        return rows if record else done

    def descend(self, target):
        while self.pass_periods(100_000, -1e9, GAIN, target + self.speed / GAIN, record=False) == 100_000:
            pass

    def hold(self, target, again=True):
        """What is held at this amplitude [nm]; `again` where it turns out periodic while its mean is taken."""
        size, block, passed, gain = self.amplitude, int(4 * self.ring) // 12 * 12 + 12, 0, GAIN
        apart, on_its_way = 0.0, True
        while passed < 130 or ((apart < 1e-6 or on_its_way) and passed < SLOWEST):
            rows = self.pass_periods(block, target, gain)
            passed += 1
            zeta = rows[:, 0] + 1j * rows[:, 1]
            apart, off = np.abs(zeta[-50:] - zeta[-1]).max() / size, abs(abs(zeta[-1]) - target) / size
            if passed > 16 and apart < 3e-8 and off < 3e-8 and np.ptp(rows[:, 2]) < 3e-7 * size:
                return stated(1, rows[-1:], target)
            on_its_way = abs(abs(zeta.mean()) - target) > 0.01 * size
            if passed > 31 and apart > 1e-6 and not (on_its_way and passed < SLOWEST):
                break
            if passed > 130:
                gain = FASTER * GAIN
        found = self.mean(target)
        return self.hold(target, again=False) if again and found["period"] == 1 else found

    def mean(self, target):
        """The mean of groups of periods, and the standard errors."""
        size, groups, kept, done = max(int(16 * self.ring), 4000) // 12 * 12 + 12, [], [], 0
        while done < MOST:
            rows = self.pass_periods(size, target, 0.5 * GAIN)
            done += size
            kept.append(rows)
            zeta = complex(*rows[:, :2].mean(0))
            groups.append((rows[:, 2].mean() + target - abs(zeta), math.degrees(math.atan2(zeta.imag, zeta.real))))
            skip = max(2, len(groups) // 5)
            if len(groups) < 8:
                continue
            errors = np.std(groups[skip:], axis=0, ddof=1) / math.sqrt(len(groups) - skip)
            if errors[0] < 5e-4 and errors[1] < 3e-3:
                break
        last = (rows[:, 0] + 1j * rows[:, 1])[-240:]
        same = [n for n in range(1, 13) if np.abs(last[n:] - last[:-n]).max() < 1e-6 * self.amplitude]
        found = stated(same[0] if same else 0, np.concatenate(kept[skip:]), target)
        return found | {"tip_offset_error": errors[0] * 1e-9, "phase_error": errors[1]}


def stated(period, rows, target):
    zeta, seen = complex(*rows[:, :2].mean(0)), rows[:, 4] + 1j * rows[:, 5]
    found = {
        "period": period, "tip_offset": (rows[:, 2].mean() + target - abs(zeta)) * 1e-9,
        "phase": 90 + math.degrees(math.atan2(zeta.imag, zeta.real)), "contact_share": rows[:, 3].mean(),
    }  # fmt: skip
    if period != 1:
        angle = np.degrees(np.angle(seen / zeta)).std()
        found |= {"amplitude_spread": np.abs(seen).std() * 1e-9, "phase_spread": angle}
    return found


def engage(library, case, setpoints=SETPOINTS, speed=SPEED, start=0.0):
    """What is held at each setpoint, with the run that holds it."""
    run, found = Run(library, case, speed, start), []
    for setpoint in setpoints:
        try:
            run.descend(setpoint * run.amplitude)
            held = run.copy()
            found.append(({"setpoint": setpoint, "held": True} | held.hold(setpoint * run.amplitude), held))
        except OverflowError:
            found.append(({"setpoint": setpoint, "held": False}, None))
    return found


def near(library, case, setpoint):
    """[tip offset, phase] of a faster approach from elsewhere, and after kicks."""
    ((first, run),) = engage(library, case, (setpoint,), 2.5 * SPEED, 0.13)
    ((second, _),) = engage(library, case, (setpoint,), FAST * case["free_amplitude"] * 1e9, 0.05)
    found = [first, second]
    for angle in (0.0, 2.1):
        kicked = run.copy()
        kicked.tip.z += KICK * run.amplitude * math.cos(angle)
        kicked.tip.v += KICK * run.amplitude * math.sin(angle)
        found.append(kicked.hold(setpoint * run.amplitude))
    return [[one["tip_offset"], one["phase"]] for one in found]


def made(library, case, setpoints=SETPOINTS):
    held = [held for held, _ in engage(library, case, setpoints)]
    for one in held:
        if one["held"] and one["period"] != 1:
            one["near"] = near(library, case, one["setpoint"])
    common = {"contact": "jkr", "poisson_ratio": POISSON, "damping_exponent": 0.5}
    return case | common | {"setpoints": held}


def make(task, count):
    library, cases = compiled(), []
    for i, case in enumerate(WILD if task == "wild" else draw(count, task == "detune")):
        cases.append(made(library, case, (0.529,) if task == "wild" else SETPOINTS))
        print(i, *((held["setpoint"], held.get("period"), held.get("phase")) for held in cases[-1]["setpoints"]))
        write(cases, {"make": OUT, "detune": DETUNED, "wild": WILDEST}[task])


def write(cases, out):
    rows = json.loads(json.dumps(cases), parse_float=lambda text: float(f"{float(text):.11g}"))
    out.write_text("[\n" + ",\n".join(json.dumps(case) for case in rows) + "\n]\n")


def compare(solver):
    """Print how often phasemap agrees, and where it does not."""
    import phasemap as pm

    table = {}
    for i, case in enumerate([case for out in (OUT, DETUNED, WILDEST) for case in json.loads(out.read_text())]):
        scope = pm.Microscope(
            pm.Cantilever(case["stiffness"], case["resonance_frequency"], case["quality_factor"]),
            pm.Tip(case["tip_radius"]),
            pm.Drive(case["free_amplitude"], case.get("frequency_ratio", 1.0) * case["resonance_frequency"]),
            pm.Interaction(case["contact"], case["decay_length"], case["damping_exponent"]),
        )
        material = pm.Material(case["modulus"], case["adhesion"], case["damping"], poisson_ratio=case["poisson_ratio"])
        for held in case["setpoints"]:
            pixel = pm.solve_pixel(material, scope, held["setpoint"], solver)
            kind = "none" if not held["held"] else "periodic" if held["period"] == 1 else "irregular"
            says = judged(held, pixel)
            table[kind, says] = table.get((kind, says), 0) + 1
            if says not in ("agrees", "both hold nothing"):
                print(
                    i, held["setpoint"], says, pixel, {k: v for k, v in held.items() if k != "near"}, held.get("near")
                )
    for (kind, says), count in sorted(table.items()):
        print(f"{kind:10} {says:28} {count}")


def judged(held, pixel):
    solved = pixel.status.name == "good"
    if not (solved and held["held"]):
        return "unsolved" if held["held"] else "claimed" if solved else "both hold nothing"
    periodic = held["period"] == 1 and pixel.motion == "periodic"
    degree, length = (3e-4, 1e-13) if periodic else (0.1, 2e-11)  # of the reference, above; of the image
    length += 5 * held.get("tip_offset_error", 0.0)  # of one that had not quite settled

    def agrees(tip_offset, phase):
        return abs(pixel.phase - phase) < degree and abs(pixel.tip_offset - tip_offset) < length

    if agrees(held["tip_offset"], held["phase"]):
        return "agrees"
    return "agrees with one near by" if any(agrees(*one) for one in held.get("near", [])) else "WRONG"


if __name__ == "__main__":
    task, *rest = sys.argv[1:]
    if task == "compare":
        compare(rest[0] if rest else "orbit")
    else:
        make(task, int(rest[0]) if rest else COUNT)
