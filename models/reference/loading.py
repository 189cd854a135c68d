"""Batches prepared in a thread of their own while the network learns."""

import queue
import threading
import time


class Prefetched:
    """An endless iterator's items, up to `ahead` made in advance; `waited` and `worked` are seconds so far."""

    def __init__(self, items, ahead=3):
        self.items, self.ready, self.stopped = items, queue.Queue(ahead), threading.Event()
        self.waited = self.worked = 0.0
        self.thread = threading.Thread(target=self.work, daemon=True)
        self.thread.start()

    def work(self):
        try:
            while not self.stopped.is_set():
                began = time.thread_time()
                item = next(self.items)
                self.worked += time.thread_time() - began
                self.offer(item)
        except BaseException as error:  # handed to whoever waits, SystemExit of the data included
            self.offer(error)

    def offer(self, item):
        while not self.stopped.is_set():
            try:
                return self.ready.put(item, timeout=0.2)
            except queue.Full:
                continue

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.stopped.set()
        self.thread.join()

    def next(self):
        """The next item; an error of its making is raised here."""
        began = time.monotonic()
        item = self.ready.get()
        self.waited += time.monotonic() - began
        if isinstance(item, BaseException):
            raise item
        return item
