// Pages from disk may start no workers: the script of one, here of the search, runs in a hidden frame instead.
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(address) {
      super();
      this.frame = document.createElement("iframe");
      this.frame.hidden = true;
      document.body.append(this.frame);
      this.queue = [];
      const inner = this.frame.contentWindow;
      inner.postMessage = (data) => {
        const event = new MessageEvent("message", { data });
        this.dispatchEvent(event);
        this.onmessage?.(event);
      };
      inner.importScripts = (...addresses) => Promise.all(addresses.map((one) => this.load(one)));
      this.load(address).then(() => {
        for (const data of this.queue) this.tell(data);
        this.queue = null;
      });
    }

    load(address) {
      const { contentDocument } = this.frame;
      const script = contentDocument.createElement("script");
      script.src = new URL(address, location.href).href;
      const loaded = new Promise((done) => script.addEventListener("load", done));
      contentDocument.body.append(script);
      return loaded;
    }

    tell(data) {
      this.frame.contentWindow.dispatchEvent(new MessageEvent("message", { data }));
    }

    postMessage(data) {
      if (this.queue) this.queue.push(data);
      else this.tell(data);
    }

    terminate() {
      this.frame.remove();
    }
  };
}
