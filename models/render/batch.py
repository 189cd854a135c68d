"""Many scenes, one after the other, in one process: what a new process of its own starts with."""

import time


def units(asked):
    """The pieces that appear whole or not at all: name and scene indices."""
    each = asked.shard if asked.form == "shards" else 1
    for first in range(asked.start, asked.start + asked.count, each):
        indices = range(first, min(first + each, asked.start + asked.count))
        yield (f"{first:04}" if asked.form != "shards" else f"{first:04}-{indices[-1]:04}"), indices


def work(asked, part):
    """Every --jobs-th of the units that are not there yet."""
    import drjit as dr
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    dr.set_thread_count(1)
    from . import shards
    from .capture_folder import rendered, write
    from .scene import scene

    todo = [unit for unit in units(asked) if not (asked.out / unit[0]).exists()][part :: asked.jobs]
    left, done, began = sum(len(indices) for _, indices in todo), 0, time.monotonic()
    for name, indices in todo:
        kept = []
        for index in indices:
            made = scene(asked.split, index, asked.seed, asked.lights, asked.packaged)
            with_ambient = asked.ambient_every > 0 and index % asked.ambient_every == asked.ambient_every - 1
            channels = rendered(made, asked.size, asked.direct_side, asked.indirect_side, asked.bounces, with_ambient,
                                asked.relit, asked.environments)
            if asked.form == "shards":
                kept.append(shards.arrays(made, channels))
            else:
                write(made, channels, asked.out / name, asked.size, asked.depth_noise)
            done, left = done + 1, left - 1
            each = (time.monotonic() - began) / done
            print(f"{asked.split} {index:04} {made.facts['layout']:5} {len(made.corners):7} triangles, process {part}: "
                  f"{each:.1f} s a scene, {each * left / 60:.1f} min left", flush=True)
        if kept:
            shards.write(kept, asked.out / name)
