"""A real browser, headless, driven through its own debugging pipe: no driver, no port."""

import base64
from contextlib import suppress
import fcntl
import json
import os
from select import select
from shutil import which
import subprocess
import sys

CHROMIUM = which('chromium') or which('chromium-browser') or which('google-chrome')
_ANSWER_TIMEOUT_S = 60
#: Puts the two pipes where the browser looks for them, and becomes the browser.
_LAUNCH = """
import os, sys
os.dup2(int(sys.argv[1]), 3)
os.dup2(int(sys.argv[2]), 4)
os.execv(sys.argv[3], sys.argv[3:])
"""


class Browser:
    """
    One browser with one page.

    Commands go to its file descriptor 3 and answers come from its 4, JSON ended by a zero byte.
    """

    def __init__(self, profile):
        to_browser, self._out = os.pipe()
        self._in, from_browser = os.pipe()
        # Copies far away from 3 and 4, so that neither can be overwritten by the other.
        ends = [fcntl.fcntl(end, fcntl.F_DUPFD, 50) for end in (to_browser, from_browser)]
        self._process = subprocess.Popen(
            [sys.executable, '-c', _LAUNCH, *map(str, ends), str(CHROMIUM), '--headless=new',
             '--no-sandbox',
             '--disable-gpu', '--disable-dev-shm-usage', '--hide-scrollbars', '--no-first-run',
             f'--user-data-dir={profile}', '--remote-debugging-pipe', 'about:blank'],
            pass_fds=ends, stderr=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
        )  # fmt: skip
        for end in (to_browser, from_browser, *ends):
            os.close(end)
        self._number, self._session, self._buffer = 0, None, b''
        self.events: list[dict] = []
        target = self.send('Target.createTarget', url='about:blank')['targetId']
        attached = self.send('Target.attachToTarget', targetId=target, flatten=True)
        self._session = attached['sessionId']
        for domain in ('Page', 'Runtime', 'Log', 'Network'):
            self.send(f'{domain}.enable')

    def _read(self):
        while b'\0' not in self._buffer:
            assert select([self._in], [], [], _ANSWER_TIMEOUT_S)[0], 'the browser is silent'
            part = os.read(self._in, 1 << 20)
            assert part, 'the browser has ended'
            self._buffer += part
        message, self._buffer = self._buffer.split(b'\0', 1)
        return json.loads(message)

    def send(self, method, **parameters):
        """Send a command and wait for its answer; what comes before it are events."""
        self._number += 1
        message = {'id': self._number, 'method': method, 'params': parameters}
        if self._session:
            message['sessionId'] = self._session
        data = json.dumps(message).encode() + b'\0'
        while data:
            data = data[os.write(self._out, data) :]
        while True:
            answer = self._read()
            if answer.get('id') == self._number:
                assert 'error' not in answer, answer
                return answer['result']
            self.events.append(answer)

    def open(self, page, width, scheme='light'):
        """Load a file at a width, light or dark."""
        self.events.clear()
        metrics = {'width': width, 'height': 900, 'deviceScaleFactor': 1, 'mobile': False}
        self.send('Emulation.setDeviceMetricsOverride', **metrics)
        feature = {'name': 'prefers-color-scheme', 'value': scheme}
        self.send('Emulation.setEmulatedMedia', media='', features=[feature])
        self.send('Page.navigate', url=page.as_uri())
        while not any(e.get('method') == 'Page.loadEventFired' for e in self.events):
            self.events.append(self._read())

    def evaluate(self, expression):
        """Run JavaScript; the value has to be JSON."""
        answer = self.send('Runtime.evaluate', expression=expression, returnByValue=True)
        assert 'exceptionDetails' not in answer, answer
        return answer['result'].get('value')

    def complaints(self):
        """Everything that the page printed, threw, logged, or loaded besides itself."""
        bad = {'Runtime.exceptionThrown', 'Runtime.consoleAPICalled', 'Log.entryAdded'}
        requests = [
            event['params']['request']['url']
            for event in self.events
            if event.get('method') == 'Network.requestWillBeSent'
        ]
        return [e for e in self.events if e.get('method') in bad] + requests[1:]

    def pdf(self):
        self.send('Emulation.setEmulatedMedia', media='print', features=[])
        return base64.b64decode(self.send('Page.printToPDF', preferCSSPageSize=True)['data'])

    def close(self):
        with suppress(AssertionError, OSError):
            self.send('Browser.close')
        self._process.wait(timeout=30)
        os.close(self._out)
        os.close(self._in)
