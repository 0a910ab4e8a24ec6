"""What generated code costs on a Cortex-M4F and a Cortex-M7, emulated: ROM, RAM, stack, instructions.

    python3 benches/cortex-m/measure.py DIR...

Each DIR is an export of `pinc export --to c`. Needs gcc-arm-none-eabi, libnewlib-arm-none-eabi and
qemu-system-arm. QEMU counts instructions, not cycles. ROM is code and tables of the generated files, without
the functions of libm; RAM is the controller's struct; the worst call of the self-test counts.
"""

import re
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
BOARDS = {
    "Cortex-M4F, float": ("mps2-an386", "cortex-m4", "fpv4-sp-d16", "float"),
    "Cortex-M4F, double in software": ("mps2-an386", "cortex-m4", "fpv4-sp-d16", "double"),
    "Cortex-M7, double": ("mps2-an500", "cortex-m7", "fpv5-d16", "double"),
}
WRAPPER = """
#include "{header}"
static cost cost_of_{function} = {{"{function}", 0, 0}};
{result} __real_{function}({parameters});
{result} __wrap_{function}({parameters})
{{
    {result_value}
    MEASURE(cost_of_{function}, {assign}__real_{function}({arguments}));
    {give}
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


def measured(name, kind):
    """The header of the measured functions, for an export of this kind."""
    functions = ["net_step", "net_linearize"] if kind == "net" else [f"{kind}_step"]
    text, reports = "", ""
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
        )
        reports += f'    printf("{function} %lu %lu\\n", (unsigned long)(cost_of_{function}.ticks * 10 / 16), (unsigned long)cost_of_{function}.stack);\n'
    ram = "0" if kind == "net" else f"sizeof({name}_{kind})"
    text += f'static void report(void)\n{{\n{reports}    printf("ram %lu\\n", (unsigned long){ram});\n}}\n'
    return text, [f"{name}_{short}" for short in functions]


def measure(directory):
    """The rows of a table for an export."""
    selftest = next(directory.glob("*_selftest.c"))
    name = selftest.name.removesuffix("_selftest.c")
    sources = [f for f in sorted(directory.glob("*.c")) if f != selftest]
    kinds = ("feedback", "mpc", "net")
    kind = next(kind for kind in kinds if (directory / f"{name}_{kind}.c").exists())
    header, functions = measured(name, kind)
    for title, (board, cpu, fpu, real) in BOARDS.items():
        with tempfile.TemporaryDirectory() as work:
            (Path(work) / "measured.h").write_text(header)
            flags = [f"-mcpu={cpu}", "-mthumb", f"-mfpu={fpu}", "-mfloat-abi=hard", "-O2", "-std=c99"]
            flags += [f"-D{name.upper()}_REAL={real}", f"-I{directory}", f"-I{work}"]
            objects = []
            for source in [*sources, selftest, HERE / "board.c"]:
                target = Path(work) / f"{source.stem}.o"
                own = ["-std=gnu99"] if source.name == "board.c" else []
                run("arm-none-eabi-gcc", *flags, *own, "-c", source, "-o", target)
                objects.append(target)
            sizes = run("arm-none-eabi-size", *objects[: len(sources)]).splitlines()[1:]
            rom = sum(int(line.split()[0]) + int(line.split()[1]) for line in sizes)
            wraps = [f"-Wl,--wrap={function}" for function in functions]
            run(
                "arm-none-eabi-gcc", *flags, *objects, *wraps, "--specs=rdimon.specs", "-nostartfiles",
                f"-T{HERE / 'link.ld'}", "-lm", "-lc", "-lrdimon", "-lgcc", "-o", Path(work) / "x.elf",
            )
            said = run(
                "qemu-system-arm", "-M", board, "-nographic", "-semihosting", "-icount", "shift=6",
                "-kernel", Path(work) / "x.elf",
            )
        worst = dict(re.findall(r"^(\w+) (\d+)", said, re.M))
        difference = re.search(r"largest difference (\S+),", said).group(1)
        for function in functions:
            count, stack = re.search(rf"^{function} (\d+) (\d+)$", said, re.M).groups()
            yield title, function, rom, int(worst["ram"]), int(stack), int(count), difference


def main():
    print("| target, gcc -O2 | function | ROM bytes | RAM bytes | stack bytes | instructions | self-test |")
    print("|---|---|---|---|---|---|---|")
    for directory in map(Path, sys.argv[1:]):
        for title, function, rom, ram, stack, count, difference in measure(directory.resolve()):
            print(f"| {title} | `{function}` | {rom} | {ram} | {stack} | {count} | {difference} |", flush=True)


if __name__ == "__main__":
    main()
