"""What generated code costs on a Cortex-M4F and a Cortex-M7, emulated: ROM, RAM, stack, instructions.

    python3 benches/cortex-m/measure.py DIR...

Each DIR is an export of `pinc export --to c` or a result of `pinc shrink`. Needs gcc-arm-none-eabi, libnewlib-arm-none-eabi and
qemu-system-arm. QEMU counts instructions, not cycles. ROM is code and tables of the generated files, without
the functions of libm; RAM is the controller's struct; the worst call of the self-test counts.
"""

import re
import subprocess
import sys
import tempfile
from pathlib import Path

BOARD = Path(__file__).resolve().parents[2] / "crates" / "pinc-bench" / "board"
BOARDS = {
    "Cortex-M4F, float": ("mps2-an386", "cortex-m4", "fpv4-sp-d16", "float"),
    "Cortex-M4F, double in software": ("mps2-an386", "cortex-m4", "fpv4-sp-d16", "double"),
    "Cortex-M7, double": ("mps2-an500", "cortex-m7", "fpv5-d16", "double"),
}
WRAPPER = """
#include "{header}"
static cost cost_of_{function} = {{"{function}", 0, 0, 0}};
{result} __real_{function}({parameters});
{result} __wrap_{function}({parameters})
{{
    {result_value}
    MEASURE(cost_of_{function}, {assign}__real_{function}({arguments}));
    {also}
    {give}
}}
"""
# The decision of a net in place of the controller, in the situations of the controller's steps.
POLICY = """
#include "{n}_policy.h"
static cost cost_of_{n}_policy_step = {{"{n}_policy_step", 0, 0, 0}};
static {n}_policy policy;
static void decide(const {N}_REAL *x, const {N}_REAL *r)
{{
    {N}_REAL u[{N}_NU];
    MEASURE(cost_of_{n}_policy_step, (void){n}_policy_step(&policy, x, r, u));
}}
"""
SHAPES = {
    "mpc_step": ("{n}_status", "{n}_mpc *m, const {N}_REAL *x, const {N}_REAL *r, {N}_REAL *u", "m, x, r, u"),
    "feedback_step": (
        "{n}_status",
        "{n}_feedback *f, const {N}_REAL *y, const {N}_REAL *r, {N}_REAL *u",
        "f, y, r, u",
    ),
    "net_step": ("void", "const {N}_REAL *x, const {N}_REAL *u, {N}_REAL *y", "x, u, y"),
    "net_linearize": (
        "void",
        "const {N}_REAL *x, const {N}_REAL *u, {N}_REAL *y, {N}_REAL *a, {N}_REAL *b",
        "x, u, y, a, b",
    ),
}


def run(*command, cwd=None):
    done = subprocess.run([str(c) for c in command], cwd=cwd, text=True, capture_output=True)
    if done.returncode != 0:
        sys.exit(f"{' '.join(map(str, command))}:\n{done.stdout}{done.stderr}")
    return done.stdout


def measured(name, kind, has_policy):
    """The header of the measured functions, for an export of this kind."""
    functions = ["net_step", "net_linearize"] if kind == "net" else [f"{kind}_step"]
    text, reports = POLICY.format(n=name, N=name.upper()) if has_policy else "", ""
    for short in functions:
        result, parameters, arguments = (t.format(n=name, N=name.upper()) for t in SHAPES[short])
        function = f"{name}_{short}"
        value = result != "void"
        text += WRAPPER.format(
            header=f"{name}_{kind}.h",
            function=function,
            result=result,
            parameters=parameters,
            arguments=arguments,
            result_value=f"{result} result;" if value else "",
            assign="result = " if value else "",
            give="return result;" if value else "",
            also="decide(x, r);" if has_policy else "",
        )
    own = [f"{name}_{short}" for short in functions]
    measured = own + ([f"{name}_policy_step"] if has_policy else [])
    for function in measured:
        kept = "policy" if function.endswith("_policy_step") else kind
        ram = "0" if kept == "net" else f"sizeof({name}_{kept})"
        ticks = [f"(unsigned long)(cost_of_{function}.{field} * 10 / 16)" for field in ("ticks", "fewest")]
        values = ", ".join([*ticks, f"(unsigned long)cost_of_{function}.stack", f"(unsigned long){ram}"])
        reports += f'    printf("{function} %lu %lu %lu %lu\\n", {values});\n'
    text += f"static void report(void)\n{{\n{reports}}}\n"
    return text, own, measured


def measure(directory):
    """The rows of a table for an export."""
    selftest = next(directory.glob("*_selftest.c"))
    name = selftest.name.removesuffix("_selftest.c")
    sources = [f for f in sorted(directory.glob("*.c")) if f != selftest]
    kinds = ("feedback", "mpc", "net")
    kind = next(kind for kind in kinds if (directory / f"{name}_{kind}.c").exists())
    has_policy = (directory / f"{name}_policy.c").exists()
    header, wrapped, functions = measured(name, kind, has_policy)
    for title, (board, cpu, fpu, real) in BOARDS.items():
        with tempfile.TemporaryDirectory() as work:
            (Path(work) / "measured.h").write_text(header)
            flags = [f"-mcpu={cpu}", "-mthumb", f"-mfpu={fpu}", "-mfloat-abi=hard", "-O2", "-std=c99"]
            flags += [f"-D{name.upper()}_REAL={real}", f"-I{directory}", f"-I{work}"]
            objects = []
            for source in [*sources, selftest, BOARD / "board.c"]:
                target = Path(work) / f"{source.stem}.o"
                own = ["-std=gnu99"] if source.name == "board.c" else []
                run("arm-none-eabi-gcc", *flags, *own, "-c", source, "-o", target)
                objects.append(target)
            sizes = run("arm-none-eabi-size", *objects[: len(sources)]).splitlines()[1:]
            rom = {source.stem: sum(map(int, line.split()[:2])) for source, line in zip(sources, sizes)}
            wraps = [f"-Wl,--wrap={function}" for function in wrapped]
            run(
                "arm-none-eabi-gcc", *flags, *objects, *wraps, "--specs=rdimon.specs", "-nostartfiles",
                f"-T{BOARD / 'link.ld'}", "-lm", "-lc", "-lrdimon", "-lgcc", "-o", Path(work) / "x.elf",
            )
            said = run(
                "qemu-system-arm", "-M", board, "-nographic", "-semihosting", "-icount", "shift=6",
                "-kernel", Path(work) / "x.elf",
            )
        difference = re.search(r"largest difference (\S+),", said).group(1)
        for function in functions:
            of_policy = {f"{name}_policy", f"{name}_net"}
            is_policy = function == f"{name}_policy_step"
            used = [s for s in rom if (s in of_policy if is_policy else s != f"{name}_policy")]
            line = re.search(rf"^{function} (\d+) (\d+) (\d+) (\d+)$", said, re.M)
            most, fewest, stack, ram = map(int, line.groups())
            yield title, function, sum(rom[s] for s in used), ram, stack, most, fewest, difference


def main():
    columns = "ROM bytes | RAM bytes | stack bytes | most instructions | fewest | self-test"
    print(f"| target, gcc -O2 | function | {columns} |")
    print("|---|---|---|---|---|---|---|---|")
    for directory in map(Path, sys.argv[1:]):
        for title, function, *numbers in measure(directory.resolve()):
            print(f"| {title} | `{function}` | {' | '.join(map(str, numbers))} |", flush=True)


if __name__ == "__main__":
    main()
